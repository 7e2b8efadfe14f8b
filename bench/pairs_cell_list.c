/* Structure function of irregular points by a cell list: what bench/roughness_peers.py
   compares with. Points sorted by cells as wide as the greatest lag are met once; the
   squared distance sorts out most pairs before a root is taken. */
#include <math.h>
#include <stdlib.h>

static long cells(double extent, double width) { return (long)(extent / width) + 1; }

/* Bins of `width` from `low` on; sums[4 b ...] = pairs, sum of d^2, of |dz|, of dz^2. */
void structure_function(const double *points, long n, double low, double width, long bins,
                        double *sums)
{
    double high = low + width * (double)bins, least[2] = {INFINITY, INFINITY}, most[2] = {-INFINITY, -INFINITY};
    for (long i = 0; i < n; i++)
        for (int a = 0; a < 2; a++) {
            double v = points[3 * i + a];
            if (v < least[a]) least[a] = v;
            if (v > most[a]) most[a] = v;
        }
    long nx = cells(most[0] - least[0], high), ny = cells(most[1] - least[1], high);
    long *start = calloc((size_t)(nx * ny) + 2, sizeof(long)), *home = malloc((size_t)n * sizeof(long));
    double *sorted = malloc((size_t)n * 3 * sizeof(double));
    for (long i = 0; i < n; i++) {
        home[i] = (long)((points[3 * i + 1] - least[1]) / high) * nx + (long)((points[3 * i] - least[0]) / high);
        start[home[i] + 2]++;
    }
    for (long c = 2; c < nx * ny + 2; c++) start[c] += start[c - 1];
    for (long i = 0; i < n; i++) {
        long at = start[home[i] + 1]++;
        for (int a = 0; a < 3; a++) sorted[3 * at + a] = points[3 * i + a];
    }
    const double low2 = low * low, high2 = high * high, per = 1.0 / width;
    static const int next[5][2] = {{0, 0}, {1, 0}, {-1, 1}, {0, 1}, {1, 1}};
    for (long cy = 0; cy < ny; cy++)
        for (long cx = 0; cx < nx; cx++)
            for (int k = 0; k < 5; k++) {
                long ox = cx + next[k][0], oy = cy + next[k][1];
                if (ox < 0 || ox >= nx || oy >= ny) continue;
                long c = cy * nx + cx, o = oy * nx + ox;
                for (long i = start[c]; i < start[c + 1]; i++) {
                    double x = sorted[3 * i], y = sorted[3 * i + 1], z = sorted[3 * i + 2];
                    for (long j = k ? start[o] : i + 1; j < start[o + 1]; j++) {
                        double dx = sorted[3 * j] - x, dy = sorted[3 * j + 1] - y, d2 = dx * dx + dy * dy;
                        if (d2 < low2 || d2 >= high2) continue;
                        double dz = sorted[3 * j + 2] - z;
                        double *bin = sums + 4 * (long)((sqrt(d2) - low) * per);
                        bin[0] += 1.0;
                        bin[1] += d2;
                        bin[2] += fabs(dz);
                        bin[3] += dz * dz;
                    }
                }
            }
    free(start);
    free(home);
    free(sorted);
}
