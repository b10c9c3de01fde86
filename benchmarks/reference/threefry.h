/* Threefry-2x32 with 20 rounds: (counter, key) -> 2 random words; round: c0 += c1, c1 = rotate(c1) ^ c0, every fourth one adds
 * a word of the key schedule. Salmon, Moraes, Dror and Shaw, Parallel random numbers: as easy as 1, 2, 3, SC 2011. No state: a
 * lane's stream depends on its counter alone, and a loop over lanes vectorises (Philox needs products of 64 bits, which AVX-512
 * makes of three). */
#pragma once
#include <stdint.h>

typedef struct {
    uint32_t c0, c1;
} words;

static inline __attribute__((always_inline)) words threefry(uint32_t c0, uint32_t c1, uint32_t k0, uint32_t k1) {
    const uint32_t key[3] = {k0, k1, 0x1BD11BDAu ^ k0 ^ k1};
    static const int rotations[8] = {13, 15, 26, 6, 17, 29, 16, 24};
    c0 += k0, c1 += k1;
#pragma GCC unroll 20
    for (int i = 0; i < 20; i++) {
        const int r = rotations[i % 8], group = i / 4 + 1;
        c0 += c1, c1 = (c1 << r | c1 >> (32 - r)) ^ c0;
        if (i % 4 == 3) c0 += key[group % 3], c1 += key[(group + 1) % 3] + group;
    }
    return (words){c0, c1};
}
