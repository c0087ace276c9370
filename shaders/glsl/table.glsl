// Look-up in a colour table (docs/pipeline.md section 5). The including shader declares CURVE, and its push
// constants as `p`. This file is C++, too: server/render/host/lanes-inl.h says what that asks for.

// The includer also declares table_points: four words per lattice point. The low 16 bits are R, G and B of the
// point, the high 16 bits those of its neighbour along the cell's diagonal.
const float FRACTIONS = float(1 << TABLE_FRACTION_BITS);
const float UNIT = TABLE_MAX_ROOT / (65535.0 * FRACTIONS);

// The position of x >= 0 along an axis, in lattice points with TABLE_FRACTION_BITS bits of fraction. At or
// beyond the end of the axis it is just below the last point.
uint table_position(float x) {
  float knees = CURVE == CURVE_TABLE_AP1 ? 1.0 / TABLE_AXIS_KNEE_AP1 : 1.0 / TABLE_AXIS_KNEE;
  uint bits = floatBitsToUint(x * knees + 1.0);
  float octave = float(int(bits >> 23) - 127);
  float within = uintBitsToFloat((bits & 0x007fffffu) | 0x3f800000u) - 1.0;
  float scale = p.table_scale;
  int position = int(octave * scale + within * (scale * (4.0 / 3.0) - scale * (1.0 / 3.0) * within));
  return uint(min(position, int((p.table_size - 1u) << TABLE_FRACTION_BITS) - 1));
}

// A tetrahedron of the lattice, and a place in it: the elements of its first corner (which holds the last, too), of
// the second and of the third, and the weights' borders, descending.
struct TableCell {
  uvec3 corners;
  uvec3 fractions;
};

// The corners of the tetrahedron are the first and the last of the cell and the two on the path between them that
// takes the axes in descending order of their fractions. Each fraction shares a word with the step of its axis, so
// that sorting the fractions sorts the steps. v is scene light in the table's primaries.
TableCell table_cell(vec3 v) {
  uvec3 position = uvec3(table_position(v.r), table_position(v.g), table_position(v.b));
  uint size = p.table_size;
  uvec3 cell = position >> TABLE_FRACTION_BITS;
  uvec3 steps = uvec3(1u, size, size * size);
  const uint step_mask = (1u << TABLE_STEP_BITS) - 1u;
  uvec3 keys = (position << TABLE_STEP_BITS) | steps;
  uint large = max(max(keys.r, keys.g), keys.b);
  uint small = min(min(keys.r, keys.g), keys.b);
  uint middle = keys.r + keys.g + keys.b - large - small;
  uint first = cell.r + size * (cell.g + size * cell.b);
  TableCell found;
  found.corners = uvec3(first, first + (large & step_mask), first + (steps.r + steps.g + steps.b) - (small & step_mask));
  found.fractions = uvec3(large >> TABLE_STEP_BITS, middle >> TABLE_STEP_BITS, small >> TABLE_STEP_BITS);
  return found;
}

// Display light in the table's primaries, by tetrahedral interpolation between the points at a cell's corners.
vec3 interpolated(uvec3 ends, uvec3 second, uvec3 third, uvec3 fractions) {
  vec3 f = vec3(ivec3(fractions));
  vec3 root = (FRACTIONS - f.r) * vec3(ivec3(ends & 0xffffu)) + (f.r - f.g) * vec3(ivec3(second & 0xffffu)) +
              (f.g - f.b) * vec3(ivec3(third & 0xffffu)) + f.b * vec3(ivec3(ends >> 16));
  return root * root * (UNIT * UNIT);
}

vec3 look_up(vec3 v) {
  TableCell cell = table_cell(v);
  return interpolated(texelFetch(table_points, int(cell.corners.r)).rgb, texelFetch(table_points, int(cell.corners.g)).rgb,
                      texelFetch(table_points, int(cell.corners.b)).rgb, cell.fractions);
}
