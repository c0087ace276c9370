// The signals of HDR displays in double precision, with the same bits on every processor. Sources: SMPTE ST
// 2084, ITU-R BT.2100. Any thread.
#pragma once

namespace candela {

inline constexpr double kReferenceWhiteNits = 203.0;  // of light 1.0. Source: ITU-R BT.2408
inline constexpr double kPqPeakNits = 10000.0;        // of the PQ signal 1

// The PQ signal, 0 .. 1, of light in units of 10000 nit, 0 .. 1.
double pq_signal(double light);
// The light of a PQ signal.
double pq_light(double signal);

// (1 - g) / g for the gamma g of HLG's OOTF on a display of this peak, 400 .. 2000 nit.
double hlg_exponent(double peak_nits);

}  // namespace candela
