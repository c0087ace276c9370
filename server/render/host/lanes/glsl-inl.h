// GLSL's scalars and vectors in C++, a vector register of pixels at a time: what shaders/glsl/*.glsl need to
// compile as C++. For each target of Highway.
//
// A shared file has no `if` or `?:` on data; mix(a, b, condition) says the same in both languages. It uses
// the components r, g and b. Its specialisation constants are template parameters here, its push constants
// and textures are members of the struct that includes it, between glsl-begin.h and glsl-end.h.
//
// Here a product that is added to something is not rounded before (Product). The compiler contracts nothing,
// so the bits are the same on every processor.
#if defined(CANDELA_HOST_GLSL_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_GLSL_INL_H
#undef CANDELA_HOST_GLSL_INL_H
#else
#define CANDELA_HOST_GLSL_INL_H
#endif

#include <hwy/highway.h>

#include <concepts>
#include <cstdint>

#include "server/render/host/lanes/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE::glsl {

#if CANDELA_HOST_TARGET

struct I;
struct U;

// A condition.
struct B {
  hn::Mask<DF> m;
};
HWY_INLINE B operator&&(B a, B b) { return {hn::And(a.m, b.m)}; }
HWY_INLINE B operator||(B a, B b) { return {hn::Or(a.m, b.m)}; }
HWY_INLINE B operator!(B a) { return {hn::Not(a.m)}; }

// A product of floats that is not rounded yet.
struct Product {
  VF a;
  VF b;
};

struct F {
  VF v;
  F() = default;
  HWY_INLINE F(VF x) : v(x) {}
  HWY_INLINE F(float x) : v(hn::Set(kFloats, x)) {}
  HWY_INLINE F(double x) : F(static_cast<float>(x)) {}
  HWY_INLINE F(const Product& x) : v(hn::Mul(x.a, x.b)) {}
  HWY_INLINE explicit F(int x) : F(static_cast<float>(x)) {}
  HWY_INLINE explicit F(uint32_t x) : F(static_cast<float>(x)) {}
  HWY_INLINE explicit F(const I& x);
  HWY_INLINE explicit F(const U& x);
};

HWY_INLINE Product operator*(F a, F b) { return {a.v, b.v}; }
HWY_INLINE F operator/(F a, F b) { return hn::Div(a.v, b.v); }
HWY_INLINE F operator+(F a, F b) { return hn::Add(a.v, b.v); }
HWY_INLINE F operator-(F a, F b) { return hn::Sub(a.v, b.v); }
HWY_INLINE F operator+(const Product& p, F c) { return hn::MulAdd(p.a, p.b, c.v); }
HWY_INLINE F operator+(F c, const Product& p) { return hn::MulAdd(p.a, p.b, c.v); }
HWY_INLINE F operator-(const Product& p, F c) { return hn::MulSub(p.a, p.b, c.v); }
HWY_INLINE F operator-(F c, const Product& p) { return hn::NegMulAdd(p.a, p.b, c.v); }
HWY_INLINE F operator+(const Product& p, const Product& q) { return p + F(q); }
HWY_INLINE F operator-(const Product& p, const Product& q) { return p - F(q); }
HWY_INLINE F operator-(F a) { return hn::Neg(a.v); }
HWY_INLINE B operator<(F a, F b) { return {hn::Lt(a.v, b.v)}; }
HWY_INLINE B operator<=(F a, F b) { return {hn::Le(a.v, b.v)}; }
HWY_INLINE B operator==(F a, F b) { return {hn::Eq(a.v, b.v)}; }

// What I and U have in common.
template <typename Self, typename Vec>
struct Integer {
  Vec v;
  friend HWY_INLINE Self operator+(Self a, Self b) { return hn::Add(a.v, b.v); }
  friend HWY_INLINE Self operator-(Self a, Self b) { return hn::Sub(a.v, b.v); }
  friend HWY_INLINE Self operator*(Self a, Self b) { return hn::Mul(a.v, b.v); }
  friend HWY_INLINE Self operator&(Self a, Self b) { return hn::And(a.v, b.v); }
  friend HWY_INLINE Self operator|(Self a, Self b) { return hn::Or(a.v, b.v); }
  friend HWY_INLINE Self operator^(Self a, Self b) { return hn::Xor(a.v, b.v); }
  friend HWY_INLINE B operator==(Self a, Self b) { return {hn::RebindMask(kFloats, hn::Eq(a.v, b.v))}; }
  friend HWY_INLINE Self mix(Self a, Self b, B which) {
    return hn::IfThenElse(hn::RebindMask(hn::DFromV<Vec>(), which.m), b.v, a.v);
  }
  friend HWY_INLINE Self& operator+=(Self& a, Self b) { return a = a + b; }
  friend HWY_INLINE Self operator<<(Self a, int bits) { return hn::ShiftLeftSame(a.v, bits); }
  friend HWY_INLINE Self operator>>(Self a, int bits) { return hn::ShiftRightSame(a.v, bits); }
};

struct I : Integer<I, VI> {
  I() = default;
  HWY_INLINE I(VI x) : Integer{x} {}
  HWY_INLINE I(int32_t x) : Integer{hn::Set(kInts, x)} {}
  HWY_INLINE explicit I(uint32_t x) : I(static_cast<int32_t>(x)) {}
  HWY_INLINE explicit I(F x) : Integer{truncate_small(x.v)} {}
  HWY_INLINE explicit I(const U& x);
};

struct U : Integer<U, VU> {
  U() = default;
  HWY_INLINE U(VU x) : Integer{x} {}
  HWY_INLINE U(uint32_t x) : Integer{hn::Set(kUints, x)} {}
  HWY_INLINE explicit U(const I& x) : Integer{hn::BitCast(kUints, x.v)} {}
};

HWY_INLINE I::I(const U& x) : Integer{hn::BitCast(kInts, x.v)} {}
HWY_INLINE F::F(const I& x) : v(hn::ConvertTo(kFloats, x.v)) {}
// x < 2^31.
HWY_INLINE F::F(const U& x) : F(I(x)) {}

HWY_INLINE U floatBitsToUint(F x) { return hn::BitCast(kUints, x.v); }
HWY_INLINE F uintBitsToFloat(U x) { return hn::BitCast(kFloats, x.v); }
HWY_INLINE F sqrt(F x) { return hn::Sqrt(x.v); }
HWY_INLINE F floor(F x) { return hn::Floor(x.v); }
HWY_INLINE F abs(F x) { return hn::Abs(x.v); }
HWY_INLINE F min(F a, F b) { return hn::Min(a.v, b.v); }
HWY_INLINE F max(F a, F b) { return hn::Max(a.v, b.v); }
HWY_INLINE F clamp(F x, F low, F high) { return min(max(x, low), high); }
HWY_INLINE I min(I a, I b) { return hn::Min(a.v, b.v); }
HWY_INLINE U min(U a, U b) { return hn::Min(a.v, b.v); }
HWY_INLINE U max(U a, U b) { return hn::Max(a.v, b.v); }
HWY_INLINE F mix(F a, F b, B which) { return hn::IfThenElse(which.m, b.v, a.v); }
HWY_INLINE F mix(F a, F b, F part) { return a * (1.0 - part) + b * part; }
// As common.glsl has them.
HWY_INLINE F at_least(F x, F low) { return max(x, low); }
HWY_INLINE F at_most(F x, F high) { return min(x, high); }

template <typename T>
struct Three {
  T r, g, b;
  Three() = default;
  HWY_INLINE Three(const T& x, const T& y, const T& z) : r(x), g(y), b(z) {}
  HWY_INLINE explicit Three(const T& x) : r(x), g(x), b(x) {}
  template <typename Other>
  HWY_INLINE explicit(!std::convertible_to<Other, T>) Three(const Three<Other>& x)
      : r(T(x.r)), g(T(x.g)), b(T(x.b)) {}
  template <typename Other>
  HWY_INLINE Three& operator-=(const Other& x) {
    return *this = *this - x;
  }
  template <typename Other>
  HWY_INLINE Three& operator^=(const Other& x) {
    return *this = *this ^ x;
  }
};

template <typename T>
inline constexpr bool kIsThree = false;
template <typename T>
inline constexpr bool kIsThree<Three<T>> = true;

// Component by component; a scalar stands for three of it.
#define CANDELA_EACH(op)                                                                           \
  template <typename X, typename Y>                                                                \
  HWY_INLINE auto operator op(const Three<X>& x, const Three<Y>& y)->Three<decltype(x.r op y.r)> { \
    return {x.r op y.r, x.g op y.g, x.b op y.b};                                                   \
  }                                                                                                \
  template <typename X, typename Y>                                                                \
  requires(!kIsThree<Y>) HWY_INLINE auto operator op(const Three<X>& x, const Y& y)                \
      ->Three<decltype(x.r op y)> {                                                                \
    return {x.r op y, x.g op y, x.b op y};                                                         \
  }                                                                                                \
  template <typename X, typename Y>                                                                \
  requires(!kIsThree<X>) HWY_INLINE auto operator op(const X& x, const Three<Y>& y)                \
      ->Three<decltype(x op y.r)> {                                                                \
    return {x op y.r, x op y.g, x op y.b};                                                         \
  }
CANDELA_EACH(+)
CANDELA_EACH(-)
CANDELA_EACH(*)
CANDELA_EACH(/)
CANDELA_EACH(&)
CANDELA_EACH(|)
CANDELA_EACH(^)
CANDELA_EACH(<<)
CANDELA_EACH(>>)
#undef CANDELA_EACH

using vec3 = Three<F>;
using uvec3 = Three<U>;
using ivec3 = Three<I>;
using bvec3 = Three<B>;

HWY_INLINE uvec3 floatBitsToUint(const vec3& x) {
  return {floatBitsToUint(x.r), floatBitsToUint(x.g), floatBitsToUint(x.b)};
}
HWY_INLINE vec3 uintBitsToFloat(const uvec3& x) {
  return {uintBitsToFloat(x.r), uintBitsToFloat(x.g), uintBitsToFloat(x.b)};
}
HWY_INLINE F dot(const vec3& x, const vec3& y) { return (x.r * y.r + x.g * y.g) + x.b * y.b; }
HWY_INLINE vec3 normalize(const vec3& x) { return x * F(1.0 / sqrt(dot(x, x))); }
HWY_INLINE vec3 reflect(const vec3& x, const vec3& n) { return x - F(2.0 * dot(n, x)) * n; }
HWY_INLINE vec3 sqrt(const vec3& x) { return {sqrt(x.r), sqrt(x.g), sqrt(x.b)}; }
HWY_INLINE vec3 abs(const vec3& x) { return {abs(x.r), abs(x.g), abs(x.b)}; }
HWY_INLINE vec3 at_least(const vec3& x, F low) {
  return {at_least(x.r, low), at_least(x.g, low), at_least(x.b, low)};
}
HWY_INLINE vec3 at_most(const vec3& x, F high) {
  return {at_most(x.r, high), at_most(x.g, high), at_most(x.b, high)};
}
HWY_INLINE bvec3 lessThanEqual(const vec3& x, const vec3& y) { return {x.r <= y.r, x.g <= y.g, x.b <= y.b}; }
HWY_INLINE B operator==(const vec3& x, const vec3& y) {
  return {hn::And(hn::And((x.r == y.r).m, (x.g == y.g).m), (x.b == y.b).m)};
}
HWY_INLINE vec3 mix(const vec3& a, const vec3& b, const bvec3& which) {
  return {mix(a.r, b.r, which.r), mix(a.g, b.g, which.g), mix(a.b, b.b, which.b)};
}
HWY_INLINE vec3 mix(const vec3& a, const vec3& b, F part) {
  return {mix(a.r, b.r, part), mix(a.g, b.g, part), mix(a.b, b.b, part)};
}
HWY_INLINE F luminance(const vec3& c) { return (0.2126 * c.r + 0.7152 * c.g) + 0.0722 * c.b; }

// A texel buffer of four words an element. A fetch beyond its end takes the last element.
struct utextureBuffer {
  const uint32_t* words = nullptr;
  uint32_t elements = 0;
};

// The elements at[0], at[4], at[8] ...: one for each 16 bytes of the vector.
template <typename D>
HWY_INLINE hn::Vec<D> load_elements(D d, const uint32_t* words, const uint32_t* at) {
  if constexpr (hn::MaxLanes(d) == 4) {
    return hn::LoadU(d, words + 4 * size_t{at[0]});
  } else {
    const hn::Half<D> half;
    return hn::Combine(d, load_elements(half, words, at + hn::MaxLanes(d) / 2),
                       load_elements(half, words, at));
  }
}

struct uvec4 {
  uvec3 rgb;
  U a;
};

// The elements `at`, one for each lane: whole elements and a transposition. Gathers take one word at a time.
HWY_INLINE uvec4 transposed_elements(const uint32_t* words, const uint32_t* at) {
  const VU e0 = load_elements(kUints, words, at);
  const VU e1 = load_elements(kUints, words, at + 1);
  const VU e2 = load_elements(kUints, words, at + 2);
  const VU e3 = load_elements(kUints, words, at + 3);
  const hn::Repartition<uint64_t, DU> pairs;
  const auto rg0 = hn::BitCast(pairs, hn::InterleaveLower(kUints, e0, e1));
  const auto rg2 = hn::BitCast(pairs, hn::InterleaveLower(kUints, e2, e3));
  const auto ba0 = hn::BitCast(pairs, hn::InterleaveUpper(kUints, e0, e1));
  const auto ba2 = hn::BitCast(pairs, hn::InterleaveUpper(kUints, e2, e3));
  return {uvec3(hn::BitCast(kUints, hn::InterleaveLower(pairs, rg0, rg2)),
                hn::BitCast(kUints, hn::InterleaveUpper(pairs, rg0, rg2)),
                hn::BitCast(kUints, hn::InterleaveLower(pairs, ba0, ba2))),
          hn::BitCast(kUints, hn::InterleaveUpper(pairs, ba0, ba2))};
}

// The same element for every lane.
HWY_INLINE uvec4 texelFetch(const utextureBuffer& texture, int index) {
  const uint32_t* const words = texture.words + 4 * index;
  return {uvec3(U(words[0]), U(words[1]), U(words[2])), U(words[3])};
}

HWY_INLINE uvec4 texelFetch(const utextureBuffer& texture, I index) {
  HWY_ALIGN uint32_t at[hn::MaxLanes(kUints)];
  hn::Store(min(U(index), U(texture.elements - 1)).v, kUints, at);
  return transposed_elements(texture.words, at);
}

#endif  // CANDELA_HOST_TARGET

}  // namespace candela::host::HWY_NAMESPACE::glsl
HWY_AFTER_NAMESPACE();

#endif
