/* The paper's plant in plain C, for the benchmark and as a second opinion: exact arcs, the law of eq. (u-defn), no vector
 * code by hand. Build: gcc -O3 -march=native paper_core.c -o paper_core -lm
 * Use:   paper_core NOISE RUNS STEPS K SECONDS
 * NOISE holds RUNS x STEPS doubles [m/s], one run after another. Flies them all again and again for SECONDS, then
 * prints one line: rate [steps/s] of the median pass, and the means of r - r_a, its square, r_dot^2 and u^2.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { PASSES_MAX = 10000 };

static const double V = 1.0, HOLD_S = 0.5, R_A = 10.0, X0 = -20.0, Y0 = 0.0;

static double turn_rate(double r, double r_dot, double k, double r_s) {
    if (r >= r_s) {
        double q = r_s / r;
        return -k * (r_dot + V * sqrt(1.0 - q * q));
    }
    double q = r / r_s;
    return -k * (r_dot - V * sqrt(1.0 - q * q));
}

static void fly(const double *noise, long steps, double k, double r_s, double sums[4]) {
    double x = X0, y = Y0, c = 1.0, s = 0.0;
    for (long n = 0; n < steps; n++) {
        double r = sqrt(x * x + y * y);
        double r_dot = V * (x * c + y * s) / r;
        double u = turn_rate(r, r_dot + noise[n], k, r_s), e = r - R_A;
        sums[0] += e;
        sums[1] += e * e;
        sums[2] += r_dot * r_dot;
        sums[3] += u * u;
        double half = 0.5 * HOLD_S * u, sin_h = sin(half), cos_h = cos(half);
        double chord = V * HOLD_S * (half != 0.0 ? sin_h / half : 1.0);
        x += chord * (c * cos_h - s * sin_h);
        y += chord * (s * cos_h + c * sin_h);
        double cos_2h = 1.0 - 2.0 * sin_h * sin_h, sin_2h = 2.0 * sin_h * cos_h, turned = c * cos_2h - s * sin_2h;
        s = s * cos_2h + c * sin_2h;
        c = turned;
    }
}

static double now_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int ascending(const void *a, const void *b) {
    double d = *(const double *)a - *(const double *)b;
    return (d > 0.0) - (d < 0.0);
}

int main(int argc, char **argv) {
    if (argc != 6) {
        fprintf(stderr, "usage: paper_core NOISE RUNS STEPS K SECONDS\n");
        return 2;
    }
    long runs = atol(argv[2]), steps = atol(argv[3]);
    double k = atof(argv[4]), end_s, r_s = sqrt(R_A * R_A - 1.0 / (k * k));
    double *noise = malloc(sizeof *noise * (size_t)(runs * steps)), took[PASSES_MAX], sums[4];
    FILE *file = fopen(argv[1], "rb");
    if (!noise || !file || fread(noise, sizeof *noise, (size_t)(runs * steps), file) != (size_t)(runs * steps)) {
        fprintf(stderr, "paper_core: cannot read %ld x %ld doubles from %s\n", runs, steps, argv[1]);
        return 1;
    }
    fclose(file);
    int passes = 0;
    end_s = now_s() + atof(argv[5]);
    do {
        double start_s = now_s();
        for (int q = 0; q < 4; q++) sums[q] = 0.0;
        for (long i = 0; i < runs; i++) fly(noise + i * steps, steps, k, r_s, sums);
        took[passes++] = now_s() - start_s;
    } while (passes < PASSES_MAX && now_s() < end_s);
    qsort(took, (size_t)passes, sizeof *took, ascending);
    double total = (double)runs * (double)steps;
    printf("%.6g %.17g %.17g %.17g %.17g\n", total / took[passes / 2], sums[0] / total, sums[1] / total, sums[2] / total,
           sums[3] / total);
    return 0;
}
