/* sin, cos, log and normals as straight-line C that a compiler vectorises: no branch, no table, no call. Float, or double with
 * -DDOUBLE. With -DLIBM sin and cos are the C library's instead: the vector functions of glibc's libmvec.
 *
 * x = q pi + r, |r| <= pi/2; sin r = r + r^3 S(r^2), cos r = 1 + r^2 C(r^2), both with the sign of (-1)^q. S and C are the
 * polynomials of least greatest absolute error on [0, (pi/2)^2] (Remez exchange; 5e-9 in float, 5e-18 in double). */
#pragma once
#include <math.h>
#include <stdint.h>
#include <string.h>

#define INLINE static inline __attribute__((always_inline))

#ifdef DOUBLE
typedef double real;
typedef uint64_t word;
typedef int64_t integer;
#define SQRT sqrt
#define ROUNDING 0x1.8p52 /* adding it rounds to an integer and leaves that in the low bits */
#define PI_HIGH 0x1.921fb54442d18p1
#define PI_LOW 0x1.1a62633145c07p-53
#define PER_PI 0x1.45f306dc9c883p-2
#define S(t) (t * (t * (t * (t * (t * (t * (t * 2.7184872642983754287e-15 - 7.6427120515824372493e-13) + 1.6058927802139282087e-10) \
    - 2.5052106605935288062e-8) + 2.7557319207778943788e-6) - 1.9841269841185911325e-4) + 8.333333333333113853e-3) \
    - 0.16666666666666664549)
#define C(t) (t * (t * (t * (t * (t * (t * (t * 4.6102775537013953052e-14 - 1.1463037847758847889e-11) + 2.0876567684810868147e-9) \
    - 2.7557316524157014549e-7) + 2.4801587279137880174e-5) - 1.3888888888785590707e-3) + 4.1666666666664367664e-2) \
    - 0.4999999999999998251)
#define LOG(t) (t * (t * (t * (t * (t * (t * (t * 1.479819860511658591e-1 + 1.531383769920937332e-1) + 1.818357216161805012e-1) \
    + 2.222219843214978396e-1) + 2.857142874366239149e-1) + 3.999999999940941908e-1) + 6.666666666666735130e-1))
#define MANTISSA 52
#define SQRT_HALF 0x3fe6a09e667f3bcd
#else
typedef float real;
typedef uint32_t word;
typedef int32_t integer;
#define SQRT sqrtf
#define ROUNDING 0x1.8p23f
#define PI_HIGH 0x1.921fb6p1f
#define PI_LOW -0x1.777a5cp-24f
#define PER_PI 0x1.45f306p-2f
#define S(t) (t * (t * (t * 2.6000396e-6f - 1.9806608e-4f) + 8.3330172e-3f) - 0.16666657f)
#define C(t) (t * (t * (t * (t * -2.6076961e-7f + 2.4761878e-5f) - 1.3888403e-3f) + 4.1666641e-2f) - 0.49999999549f)
#define LOG(t) (t * (t * (t * (t * 0.24279078841f + 0.28498786688f) + 0.40000972152f) + 0.66666662693f))
#define MANTISSA 23
#define SQRT_HALF 0x3f3504f3
#endif
#ifdef SCALAR
#define SIMD
#else
#define SIMD _Pragma("omp simd")
#endif
#define BITS (8 * (int)sizeof(real))

INLINE word bits_of(real x) {
    word bits;
    memcpy(&bits, &x, sizeof x);
    return bits;
}
INLINE real of_bits(word bits) {
    real x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* (sin, cos)(q pi + r); only the last bit of q counts */
INLINE void half_turns(word q, real r, real *s, real *c) {
    real t = r * r;
    word sign = q << (BITS - 1);
    *s = of_bits(bits_of(r + r * t * S(t)) ^ sign);
    *c = of_bits(bits_of(1 + t * C(t)) ^ sign);
}

#ifdef LIBM
/* Under other names: GCC would merge sin and cos of one argument into sincos, for which it knows no vector function, and then
 * call it once for each lane. */
#ifdef SCALAR
#define VECTOR __attribute__((const))
#else
#define VECTOR __attribute__((const, simd("notinbranch")))
#endif
#ifdef DOUBLE
VECTOR real sine(real) __asm__("sin");
VECTOR real cosine(real) __asm__("cos");
#else
VECTOR real sine(real) __asm__("sinf");
VECTOR real cosine(real) __asm__("cosf");
#endif
INLINE void sine_cosine(real x, real *s, real *c) { *s = sine(x), *c = cosine(x); }
#else
/* pi is in two parts: with fused products the remainder is good to |x| 2^-48 in float, |x| 2^-105 in double */
INLINE void sine_cosine(real x, real *s, real *c) {
    real rounded = x * PER_PI + ROUNDING, n = rounded - ROUNDING;
    half_turns(bits_of(rounded), (x - n * PI_HIGH) - n * PI_LOW, s, c);
}
#endif

/* log x for positive normal x: x = 2^k m, m in [sqrt(1/2), sqrt(2)); log m by s = (m - 1) / (m + 1), as in Sun's fdlibm. */
INLINE real logarithm(real x) {
    word bits = bits_of(x);
    integer k = (integer)(bits - SQRT_HALF) >> MANTISSA;
    real f = of_bits(bits - ((word)k << MANTISSA)) - 1, s = f / (2 + f), t = s * s, half = f * f / 2;
    return k * (real)0.69314718055994530942 - ((half - s * (half + LOG(t))) - f);
}

/* Box-Muller: sqrt(-2 log u) (sin, cos)(angle) from two uniform words; u in (0, 1] of 53 (32) bits: normals up to 8.6 (6.8). The
 * angle is a half turn and a rest in [-pi/2, pi/2): nothing is reduced. */
INLINE void normals(word radius, word angle, real *a, real *b) {
#ifdef DOUBLE
    const real u = (real)(integer)(radius >> 11) * 0x1p-53 + 0x1p-54, unit = 0x1.921fb54442d18p0 * 0x1p-63;
#else
    const real u = (real)radius * 0x1p-32f + 0x1p-33f, unit = 0x1.921fb6p0f * 0x1p-31f;
#endif
    real s, c, r = SQRT(-2 * logarithm(u));
    half_turns(angle >> (BITS - 1), (real)(integer)(angle << 1) * unit, &s, &c);
    *a = r * s;
    *b = r * c;
}
