/* What a linear two-mass drive costs per sample at the least, with eleven sensitivities.
   a (3, 3), b, g (3): x' = a x + b u + g; d (3, 5, 12): derivatives of [a b g] over the columns. */
#include <string.h>
#define COLUMNS 12

void sensitivities(const double *restrict a, const double *restrict b, const double *restrict g,
                   const double *restrict d, const double *restrict u, double *restrict out,
                   double *restrict jac, int n)
{
    double x[3] = {0.0, 0.0, 0.0}, s[3][COLUMNS] = {{0.0}}, t[3][COLUMNS];
    s[0][8] = s[1][9] = s[2][10] = 1.0;
    for (int i = 0; i < n; i++) {
        double y[3];
        out[i] = x[0];
        memcpy(jac + i * COLUMNS, s[0], sizeof s[0]);
        for (int r = 0; r < 3; r++) {
            const double *e = a + 3 * r, *f = d + 5 * COLUMNS * r;
            for (int q = 0; q < COLUMNS; q++)
                t[r][q] = (e[0] * s[0][q] + e[1] * s[1][q] + e[2] * s[2][q])
                        + (f[q] * x[0] + f[COLUMNS + q] * x[1] + f[2 * COLUMNS + q] * x[2]
                           + f[3 * COLUMNS + q] * u[i] + f[4 * COLUMNS + q]);
            y[r] = (e[2] * x[2] + (b[r] * u[i] + g[r])) + (e[0] * x[0] + e[1] * x[1]);
        }
        memcpy(s, t, sizeof s);
        memcpy(x, y, sizeof x);
    }
}
