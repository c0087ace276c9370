// Signals of HDR displays, and gain curves that lead from one rendering to another.
#pragma once

#include <array>
#include <functional>
#include <memory>

#include "shaders/color_table.h"

namespace candela {

// The signals of HDR displays in double precision, with the same bits on every processor. Sources: SMPTE ST
// 2084, ITU-R BT.2100. Any thread.

inline constexpr double kReferenceWhiteNits = 203.0;  // of light 1.0. Source: ITU-R BT.2408
inline constexpr double kPqPeakNits = 10000.0;        // of the PQ signal 1

// The PQ signal, 0 .. 1, of light in units of 10000 nit, 0 .. 1.
double pq_signal(double light);
// The light of a PQ signal.
double pq_light(double signal);

// (1 - g) / g for the gamma g of HLG's OOTF on a display of this peak, 400 .. 2000 nit.
double hlg_exponent(double peak_nits);

// What makes an SDR image an HDR one: the gain of its light by the exposed light (docs/pipeline.md section
// 5).
//
// Any thread.
class GainCurve {
 public:
  using Rgb = std::array<double, 3>;

  // Of a tone curve, from exposed light of Rec.709 to display light, for an HDR display of this peak. The
  // source's peak becomes the display's. Both are 203 .. 10000 nit. Takes 3500 calls of the curve.
  GainCurve(const std::function<Rgb(const Rgb&)>& tone_curve, double source_nits, double peak_nits);

  // log2 of the gain of a colour whose largest component is n, 0 or more: 0 .. max_log2(), or a hundredth of
  // a code more.
  double log2_gain(double n) const;
  // The largest log2 of the gain, 1/64 at least.
  double max_log2() const { return max_log2_; }

  // The grey where the tone curve's shoulder begins, and its display light above black over light there, the
  // largest of all greys.
  double shoulder() const { return shoulder_; }
  double steepest() const { return steepest_; }

  // log2_gain() over max_log2() as cubic pieces, which resolve reads.
  const std::shared_ptr<const ColorTable>& pieces() const { return pieces_; }

 private:
  double gain_at(double n) const;
  std::shared_ptr<const ColorTable> make_pieces() const;

  std::function<double(double)> grey_;  // display luminance of grey
  double source_, peak_;                // in units of reference white
  double steepest_ = 1.0;               // k: the largest display light above black over light
  double shoulder_ = 0.0;               // t: the grey where it is
  double max_log2_ = 0.0;
  std::shared_ptr<const ColorTable> pieces_;
};

}  // namespace candela
