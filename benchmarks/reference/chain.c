/* Monte Carlo of the chain x_i' = x_{i+1}, x_5' = mean of sin x_i, with its high-gain observer: per lane, joint RK4 with substeps of
 *     x' = f(x),    z' = f(z) + (alpha_i g^i)_i (x_1 + w_k - z_1),
 * noise w_k held over the sampling period, gain scale g of the lane. At sample k >= first the squared error is added. */
#define BLOCK 64
#include "lanes.h"

#define N 5
#define EACH _Pragma("GCC unroll 10") for (int j = 0; j < N; j++)

typedef real states[2 * N][BLOCK] ALIGNED; /* x, then z */
typedef struct {
    real g[N][BLOCK];
    noise w;
} world ALIGNED;

/* k = field(at);  total = sum + weight k;  next = from + reach k */
INLINE void stage(const world *restrict v, const real *restrict w, const states from, const states at, const states sum,
                  states total, real weight, states next, real reach) {
    SIMD for (int i = 0; i < BLOCK; i++) {
        real k[2 * N], e = at[0][i] + w[i] - at[N][i], sx = 0, sz = 0, s, c;
        EACH {
            sine_cosine(at[j][i], &s, &c), sx += s;
            sine_cosine(at[N + j][i], &s, &c), sz += s;
        }
        EACH {
            k[j] = j == N - 1 ? sx / N : at[(j + 1) % N][i];
            k[N + j] = (j == N - 1 ? sz / N : at[N + (j + 1) % N][i]) + v->g[j][i] * e;
        }
        EACH {
            real f = next ? from[j][i] + reach * k[j] : 0, g = next ? from[N + j][i] + reach * k[N + j] : 0;
            total[j][i] = sum[j][i] + weight * k[j], total[N + j][i] = sum[N + j][i] + weight * k[N + j];
            if (next) next[j][i] = f, next[N + j][i] = g;
        }
    }
}

HOT step(states b, const world *restrict v, const real *restrict w, real h) {
    states sum, at, next;
    stage(v, w, b, b, b, sum, h / 6, at, h / 2);
    stage(v, w, b, at, sum, sum, h / 3, next, h / 2);
    stage(v, w, b, next, sum, sum, h / 3, at, h);
    stage(v, w, b, at, sum, b, h / 6, 0, 0);
}

HOT add_errors(const states b, real (*restrict s)[BLOCK]) {
    SIMD for (int i = 0; i < BLOCK; i++) EACH { s[j][i] += (b[N + j][i] - b[j][i]) * (b[N + j][i] - b[j][i]); }
}

/* start (10), gamma (lanes), rmse (5, lanes) */
void chain(long lanes, long samples, long first, double dt, long substeps, const real *alphas, const real *start,
           const real *gamma, double sigma, uint64_t seed, real *rmse) {
#pragma omp parallel for schedule(dynamic, 1)
    for (long from = 0; from < lanes; from += BLOCK) {
        states b;
        world v = {0};
        real s[N][BLOCK] ALIGNED = {{0}};
        for (int i = 0; i < BLOCK; i++) {
            real g = gamma[from + i < lanes ? from + i : lanes - 1], power = 1;
            for (int j = 0; j < 2 * N; j++) b[j][i] = start[j];
            EACH { power *= g, v.g[j][i] = alphas[j] * power; }
        }
        for (long k = 0; k < samples; k++) {
            if (sigma > 0 && k % 2 == 0) draw(from, k / 2, seed, sigma, v.w);
            if (k >= first) add_errors(b, s);
            for (long m = 0; m < substeps; m++) step(b, &v, v.w[k % 2], dt / substeps);
        }
        for (int i = 0; i < BLOCK && from + i < lanes; i++) EACH { rmse[j * lanes + from + i] = sqrt(s[j][i] / (samples - first)); }
    }
}
