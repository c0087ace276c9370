// The matrices of y4m's planes, from R, G and B to luma and two colour differences.
#pragma once

namespace candela {

// The shares of R, G and B in luma Y, and what B - Y and R - Y are divided by.
struct LumaMatrix {
  float red, green, blue, cb, cr;
};
inline constexpr LumaMatrix kRec709Luma{.2126f, .7152f, .0722f, 1.8556f, 1.5748f};   // ITU-R BT.709
inline constexpr LumaMatrix kRec2020Luma{.2627f, .6780f, .0593f, 1.8814f, 1.4746f};  // ITU-R BT.2020

}  // namespace candela
