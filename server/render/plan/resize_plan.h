// How an image of another size is made of a frame: docs/pipeline.md section 5.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace candela {

// Texels first <= k < last of an axis.
struct TexelRange {
  uint32_t first = 0;
  uint32_t last = 0;
};

// The filter of one axis: `to` output texels from `from` texels of the frame.
struct AxisFilter {
  uint32_t from = 0;
  uint32_t to = 0;
  uint32_t mean = 0;           // an output is the mean of this many texels; 0: it is weighted
  uint32_t taps = 0;           // the most texels of an output
  std::vector<float> weights;  // of output i from i * taps on, the first of texels(i).first; empty for a mean

  // What output i is made of, and the texels that its value stays between. Neither falls with i.
  TexelRange texels(uint32_t i) const;
  TexelRange main_lobe(uint32_t i) const;
  const float* weights_of(uint32_t i) const { return weights.data() + size_t{i} * taps; }

  // "mean of 8", "Lanczos", "as it is"
  std::string words() const;
};

// The most texels of an output of an axis.
uint32_t most_taps(uint32_t from, uint32_t to);

// Pure, with the same bits on every processor. Both sizes are from 1 to v1::kMaxDimension.
AxisFilter axis_filter(uint32_t from, uint32_t to);

}  // namespace candela
