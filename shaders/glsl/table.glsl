// The look-up of a colour table (docs/pipeline.md section 5). The including shader declares its push constants as `p`.

// Four words a point of the lattice: R, G and B, 16 bits each, of the point itself in the low halves and of its
// neighbour along the diagonal in the high ones.
layout(set = 0, binding = 2) uniform utextureBuffer table_points;

const float FRACTIONS = float(1 << TABLE_FRACTION_BITS);
const float UNIT = TABLE_MAX_ROOT / (65535.0 * FRACTIONS);

// Position along an axis, in points and TABLE_FRACTION_BITS of fraction; of x at or beyond the axis' end just below the
// last point. 0 <= x.
uint table_position(float x) {
  uint bits = floatBitsToUint(x * (1.0 / TABLE_AXIS_KNEE) + 1.0);
  float octave = float(int(bits >> 23) - 127);
  float within = uintBitsToFloat((bits & 0x007fffffu) | 0x3f800000u) - 1.0;
  float scale = p.table_scale;
  int position = int(octave * scale + within * (scale * (4.0 / 3.0) - scale * (1.0 / 3.0) * within));
  return uint(min(position, int(p.table_size - 1u << TABLE_FRACTION_BITS) - 1));
}

// Light in the table's primaries to display light in the table's. A tetrahedron's corners are the cell's first and
// last and the two on the way between them along the axes in falling order of their fractions. A fraction and its
// axis' step share a word, so that sorting the one sorts the other.
vec3 look_up(vec3 v) {
  uvec3 position = uvec3(table_position(v.r), table_position(v.g), table_position(v.b));
  uint size = p.table_size;
  uvec3 cell = position >> TABLE_FRACTION_BITS;
  uvec3 steps = uvec3(1u, size, size * size);
  const int step_bits = 32 - TABLE_FRACTION_BITS;
  const uint step_mask = (1u << step_bits) - 1u;
  uvec3 keys = (position << step_bits) | steps;
  uint large = max(max(keys.r, keys.g), keys.b);
  uint small = min(min(keys.r, keys.g), keys.b);
  uint middle = keys.r + keys.g + keys.b - large - small;
  uint first = cell.r + size * (cell.g + size * cell.b);
  uvec3 ends = texelFetch(table_points, int(first)).rgb;
  uvec3 second = texelFetch(table_points, int(first + (large & step_mask))).rgb;
  uvec3 third = texelFetch(table_points, int(first + (steps.r + steps.g + steps.b) - (small & step_mask))).rgb;

  float l = float(int(large >> step_bits));
  float m = float(int(middle >> step_bits));
  float s = float(int(small >> step_bits));
  vec3 root = (FRACTIONS - l) * vec3(ivec3(ends & 0xffffu)) + (l - m) * vec3(ivec3(second & 0xffffu)) +
              (m - s) * vec3(ivec3(third & 0xffffu)) + s * vec3(ivec3(ends >> 16));
  return root * root * (UNIT * UNIT);
}
