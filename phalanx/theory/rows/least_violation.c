/* The vertex that is least in its last coordinate: the same operations in the same order as
   least_vertex of least_violation.py. Compiled without fused operations. */
#include <math.h>
#include <string.h>

#define D 7 /* most coordinates */

static double inner(int d, const double *a, const double *b) {
  double total = 0.0;
  for (int c = 0; c < d; ++c) total += a[c] * b[c];
  return total;
}

/* The point x where d rows meet, if they are independent. A row's last number is its bound. */
static int meet(int d, const double *rows, const int *chosen, double *x) {
  double t[D][D + 1], determinant = 1.0, scale = 1.0;
  for (int i = 0; i < d; ++i) {
    memcpy(t[i], rows + (size_t)chosen[i] * (d + 1), sizeof(double) * (d + 1));
    scale *= sqrt(inner(d, t[i], t[i]));
  }
  for (int c = 0; c < d; ++c) {
    int pivot = c;
    for (int i = c + 1; i < d; ++i)
      if (fabs(t[i][c]) > fabs(t[pivot][c])) pivot = i;
    if (t[pivot][c] == 0.0) return 0;
    determinant *= pivot == c ? t[c][c] : -t[pivot][c];
    for (int j = c; pivot != c && j <= d; ++j) {
      double number = t[c][j];
      t[c][j] = t[pivot][j];
      t[pivot][j] = number;
    }
    for (int i = c + 1; i < d; ++i) {
      double factor = t[i][c] / t[c][c];
      for (int j = c + 1; j <= d; ++j) t[i][j] -= factor * t[c][j];
    }
  }
  for (int c = d - 1; c >= 0; --c)
    x[c] = (t[c][d] - inner(d - c - 1, t[c] + c + 1, x + c + 1)) / t[c][c];
  return fabs(determinant) > 1e-12 * fmax(scale, 1e-300);
}

static int precedes(int d, const double *x, const double *best) {
  if (x[d - 1] != best[d - 1]) return x[d - 1] < best[d - 1];
  for (int c = 0; c < d - 1; ++c)
    if (x[c] != best[c]) return x[c] < best[c];
  return 0;
}

static int feasible(int d, int count, const double *row, const double *x) {
  for (; count-- > 0; row += d + 1)
    if (!(inner(d, x, row) <= row[d] + 1e-9 * (1.0 + fabs(row[d])))) return 0;
  return 1;
}

/* Returns whether there is a vertex; rows: shape (count, d + 1). */
int least_vertex(int d, int count, const double *rows, double *best) {
  int chosen[D], found = 0, last = d - 1;
  double x[D];
  for (int i = 0; i < d; ++i) chosen[i] = i;
  while (last >= 0) {
    if (meet(d, rows, chosen, x) && (!found || precedes(d, x, best)) &&
        feasible(d, count, rows, x)) {
      memcpy(best, x, sizeof(double) * d);
      found = 1;
    }
    for (last = d - 1; last >= 0 && chosen[last] == count - d + last;) --last;
    if (last >= 0) ++chosen[last];
    for (int j = last + 1; last >= 0 && j < d; ++j) chosen[j] = chosen[j - 1] + 1;
  }
  return found;
}
