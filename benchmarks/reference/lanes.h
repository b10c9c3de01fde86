/* What the studies share: a block of lanes that stays in the first-level cache, and its noise. */
#pragma once
#include "threefry.h"
#include "vectormath.h"

#ifndef BLOCK
#define BLOCK (1024 / (int)sizeof(real))
#endif
#define ALIGNED __attribute__((aligned(64)))
#define HOT static __attribute__((noinline)) void

typedef real noise[2][BLOCK] ALIGNED;

/* Two normals for each lane, those of steps 2 pair and 2 pair + 1. */
HOT draw(uint32_t from, uint32_t pair, uint64_t seed, real sigma, noise w) {
    const uint32_t k0 = seed, k1 = seed >> 32;
    SIMD for (int i = 0; i < BLOCK; i++) {
        real a, b;
#ifdef DOUBLE
        words r = threefry(from + (uint32_t)i, 2 * pair, k0, k1), t = threefry(from + (uint32_t)i, 2 * pair + 1, k0, k1);
        normals((word)r.c1 << 32 | r.c0, (word)t.c1 << 32 | t.c0, &a, &b);
#else
        words r = threefry(from + (uint32_t)i, pair, k0, k1);
        normals(r.c0, r.c1, &a, &b);
#endif
        w[0][i] = sigma * a, w[1][i] = sigma * b;
    }
}

/* For the checks: lanes of a block, the generator, the normals of a lane, the functions. */
const int block_lanes = BLOCK;
void random_words(uint32_t c0, uint32_t c1, uint32_t k0, uint32_t k1, uint32_t *out) {
    words r = threefry(c0, c1, k0, k1);
    out[0] = r.c0, out[1] = r.c1;
}
void random_normals(long blocks, uint64_t seed, real *out) {
    noise w;
    for (long k = 0; k < blocks; k++) draw(0, k, seed, 1, w), memcpy(out + 2 * BLOCK * k, w, sizeof w);
}
void functions(long count, const real *x, real *sines, real *cosines, real *logarithms) {
    SIMD for (long i = 0; i < count; i++) sine_cosine(x[i], sines + i, cosines + i);
    SIMD for (long i = 0; i < count; i++) logarithms[i] = logarithm(x[i]);
}
