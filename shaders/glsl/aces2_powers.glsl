// The powers of ACES 2.0 (docs/pipeline.md section 5). The host has its own: server/render/host/resolve.cc.

// Of a cone's response over its light, and back.
float cone_power(float x) { return power(x, 0.42); }
float cone_root(float x) { return power(x, 1.0 / 0.42); }
// Lightness of an achromatic response, and back.
float lightness_of(float response) { return power(response, 1.13705602); }
float achromatic_of(float lightness) { return power(lightness, 1.0 / 1.13705602); }
