/* Monte Carlo of the discrete derivative tracker, 3 derivatives and one integrator, on a noisy parabola: per lane
 *     eta- = exp(A dt) eta + B0 y_{k-1} + B1 y_k,    eta = eta- - s G eta-_0,    A = s A_4 s,  s = (1, -1, -1, -1),
 * y_k = x_1 + w_k on straight lines between samples, x the Taylor coefficients of the parabola, decrement d = 1 - exp(-mu dt) of
 * the lane and the steady gain G_{i+1} = i! / dt^i sum_{j > i} C(4, j) d^j s1(j, i + 1) / (j - 1)!, s1 Stirling's numbers.
 * At sample k >= first the squared error of the estimate is added. */
#include "lanes.h"

typedef struct {
    real x1[BLOCK], x2[BLOCK], x3[BLOCK], xi[BLOCK], z1[BLOCK], z2[BLOCK], z3[BLOCK], last[BLOCK];
    real g0[BLOCK], g1[BLOCK], g2[BLOCK], g3[BLOCK], s1[BLOCK], s2[BLOCK], s3[BLOCK];
    noise w;
} block ALIGNED;

/* sample 0 has nothing to carry: carries = 0 */
HOT step(block *restrict b, const real *restrict w, real h, real carries, real counts) {
    const real h1 = carries * h, h2 = carries * h * h / 2, h3 = carries * h * h * h / 6;
    SIMD for (int i = 0; i < BLOCK; i++) {
        real x1 = b->x1[i], x2 = b->x2[i], x3 = b->x3[i], z1 = b->z1[i], z2 = b->z2[i], z3 = b->z3[i], y = x1 + w[i];
        real xi = b->xi[i] - (h1 * z1 + h2 * z2 + h3 * z3) + h1 / 2 * (b->last[i] + y);
        real e = -xi;
        z1 += h1 * z2 + h2 * z3 - b->g1[i] * e, z2 += h1 * z3 - b->g2[i] * e, z3 -= b->g3[i] * e, xi += b->g0[i] * e;
        b->s1[i] += counts * (z1 - x1) * (z1 - x1), b->s2[i] += counts * (z2 - x2) * (z2 - x2);
        b->s3[i] += counts * (z3 - x3) * (z3 - x3);
        b->xi[i] = xi, b->z1[i] = z1, b->z2[i] = z2, b->z3[i] = z3, b->last[i] = y;
        b->x1[i] = x1 + h * x2 + h * h / 2 * x3, b->x2[i] = x2 + h * x3;
    }
}

static void gain(double d, double dt, double g[4]) {
    static const double choose[5] = {1, 4, 6, 4, 1}, factorial[5] = {1, 1, 2, 6, 24};
    static const double stirling[5][5] = {{1}, {0, 1}, {0, -1, 1}, {0, 2, -3, 1}, {0, -6, 11, -6, 1}};
    double scale = 1;
    for (int i = 0; i < 4; i++, scale /= dt) {
        double sum = 0, power = 1;
        for (int j = 1; j <= 4; j++) power *= d, sum += choose[j] * power * stirling[j][i + 1] / factorial[j - 1]; /* 0 for j <= i */
        g[i] = factorial[i] * sum * scale;
    }
}

/* start: x (3), then the estimate (3); mu (lanes), rmse (3, lanes) */
void tracker(long lanes, long samples, long first, double dt, const real *start, const real *mu, double sigma, uint64_t seed,
             real *rmse) {
#pragma omp parallel for schedule(dynamic, 1)
    for (long from = 0; from < lanes; from += BLOCK) {
        block b = {0};
        for (int i = 0; i < BLOCK; i++) {
            double g[4];
            gain(-expm1(-mu[from + i < lanes ? from + i : lanes - 1] * dt), dt, g);
            b.g0[i] = g[0], b.g1[i] = g[1], b.g2[i] = g[2], b.g3[i] = g[3];
            b.x1[i] = start[0], b.x2[i] = start[1], b.x3[i] = start[2];
            b.z1[i] = start[3], b.z2[i] = start[4], b.z3[i] = start[5];
        }
        for (long k = 0; k < samples; k++) {
            if (sigma > 0 && k % 2 == 0) draw(from, k / 2, seed, sigma, b.w);
            step(&b, b.w[k % 2], dt, k > 0, k >= first);
        }
        for (int i = 0; i < BLOCK && from + i < lanes; i++) {
            real *out = rmse + from + i, count = samples - first;
            out[0] = sqrt(b.s1[i] / count), out[lanes] = sqrt(b.s2[i] / count), out[2 * lanes] = sqrt(b.s3[i] / count);
        }
    }
}
