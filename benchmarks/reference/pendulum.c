/* Monte Carlo of the inverted pendulum with its high-gain observer: per lane, joint RK4 of
 *     x' = (x2, sin x1 + u cos x1),    z' = (z2, sin z1 + u cos z1) + (alpha1 g, alpha2 g^2) (x1 + w_k - z1),
 * u = 0.5 sin t, noise w_k held over the step, gain scale g of the lane. At sample k >= first the squared error is added, then
 * the step is made. Lanes are contiguous, a block of them stays in the first-level cache over all time, blocks go to threads.
 * Each stage is a loop of its own over the block: its vectors are independent, which hides the latency of sin and cos. */
#include "lanes.h"

typedef struct {
    real x1, x2, z1, z2;
} state;
typedef struct {
    real x1[BLOCK], x2[BLOCK], z1[BLOCK], z2[BLOCK];
} states ALIGNED;
typedef struct {
    real g1[BLOCK], g2[BLOCK];
    noise w;
} world ALIGNED;

INLINE state get(const states *b, int i) { return (state){b->x1[i], b->x2[i], b->z1[i], b->z2[i]}; }
INLINE void put(states *b, int i, state q) { b->x1[i] = q.x1, b->x2[i] = q.x2, b->z1[i] = q.z1, b->z2[i] = q.z2; }
INLINE state ahead(state q, real h, state f) {
    return (state){q.x1 + h * f.x1, q.x2 + h * f.x2, q.z1 + h * f.z1, q.z2 + h * f.z2};
}

INLINE state field(real u, state q, real w, real g1, real g2) {
    real s, c, sz, cz, e = q.x1 + w - q.z1;
    sine_cosine(q.x1, &s, &c);
    sine_cosine(q.z1, &sz, &cz);
    return (state){q.x2, s + u * c, q.z2 + g1 * e, sz + u * cz + g2 * e};
}

/* k = field(at);  total = sum + weight k;  next = from + reach k */
INLINE void stage(const world *restrict v, const real *restrict w, real u, const states *from, const states *at,
                  const states *sum, states *total, real weight, states *next, real reach) {
    SIMD for (int i = 0; i < BLOCK; i++) {
        state q = get(from, i), t = get(sum, i), k = field(u, get(at, i), w[i], v->g1[i], v->g2[i]);
        put(total, i, ahead(t, weight, k));
        if (next) put(next, i, ahead(q, reach, k));
    }
}

HOT step(states *restrict b, const world *restrict v, const real *restrict w, real h, const real *restrict u) {
    states sum, at;
    stage(v, w, u[0], b, b, b, &sum, h / 6, &at, h / 2);
    stage(v, w, u[1], b, &at, &sum, &sum, h / 3, &at, h / 2);
    stage(v, w, u[1], b, &at, &sum, &sum, h / 3, &at, h);
    stage(v, w, u[2], b, &at, &sum, b, h / 6, 0, 0);
}

HOT add_errors(const states *restrict b, real *restrict s1, real *restrict s2) {
    SIMD for (int i = 0; i < BLOCK; i++) {
        real d1 = b->z1[i] - b->x1[i], d2 = b->z2[i] - b->x2[i];
        s1[i] += d1 * d1, s2[i] += d2 * d2;
    }
}

/* us[2k], us[2k+1], us[2k+2]: u at t_k, t_k + h/2, t_k + h. start (4), gamma (lanes), rmse (2, lanes), final (4, lanes). */
void pendulum(long lanes, long samples, long first, double dt, const real *us, const real *alphas, const real *start,
              const real *gamma, double sigma, uint64_t seed, real *rmse, real *final) {
#pragma omp parallel for schedule(dynamic, 1)
    for (long from = 0; from < lanes; from += BLOCK) {
        states b;
        world v = {0};
        real s1[BLOCK] ALIGNED = {0}, s2[BLOCK] ALIGNED = {0};
        for (int i = 0; i < BLOCK; i++) {
            real g = gamma[from + i < lanes ? from + i : lanes - 1];
            put(&b, i, (state){start[0], start[1], start[2], start[3]});
            v.g1[i] = alphas[0] * g, v.g2[i] = alphas[1] * g * g;
        }
        for (long k = 0; k < samples; k++) {
            if (sigma > 0 && k % 2 == 0) draw(from, k / 2, seed, sigma, v.w);
            if (k >= first) add_errors(&b, s1, s2);
            step(&b, &v, v.w[k % 2], dt, us + 2 * k);
        }
        for (int i = 0; i < BLOCK && from + i < lanes; i++) {
            long l = from + i;
            rmse[l] = sqrt(s1[i] / (samples - first)), rmse[lanes + l] = sqrt(s2[i] / (samples - first));
            final[l] = b.x1[i], final[lanes + l] = b.x2[i], final[2 * lanes + l] = b.z1[i], final[3 * lanes + l] = b.z2[i];
        }
    }
}
