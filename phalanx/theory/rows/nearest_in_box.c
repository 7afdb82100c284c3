/* The nearest point of a box under one row: the same operations in the same order as
   nearest_in_box.py, which explains them. Compiled without fused operations. */
#include <math.h>

/* u(λ), and aᵀu(λ) as the result. `numbers` as nearest_in_box has them. */
static double at(int m, const double *numbers, double multiplier, double *u) {
  const double *u_nom = numbers, *weights = u_nom + m, *low = weights + m, *high = low + m;
  const double *a = high + m;
  double value = 0.0;
  for (int c = 0; c < m; ++c) {
    double free = u_nom[c] - multiplier * (a[c] / (weights[c] + weights[c]));
    u[c] = free < low[c] ? low[c] : free > high[c] ? high[c] : free;
    value += a[c] * u[c];
  }
  return value;
}

/* Returns whether the box has such a point. numbers: u_nom, weights, low, high and a, of m numbers
   each, then room for u, and for 2 m more. */
int nearest_in_box(int m, double *numbers, double bound, double tolerance) {
  const double *weights = numbers + m, *a = numbers + 4 * m;
  double *u = numbers + 5 * m, *ends = u + m, begin = 0.0, sizes = 0.0;
  double value = at(m, numbers, 0.0, u);
  int count = 0;
  if (value <= bound) return 1;
  for (int c = 0; c < m; ++c)
    for (int side = 2; side <= 3; ++side) {
      double slope = a[c] / (weights[c] + weights[c]);
      double end = (numbers[c] - numbers[side * m + c]) / slope;
      if (slope == 0.0 || !(end > 0.0)) continue;
      int place = count++;
      for (; place > 0 && ends[place - 1] > end; --place) ends[place] = ends[place - 1];
      ends[place] = end;
    }
  for (int i = 0; i < count; ++i) {
    double then = at(m, numbers, ends[i], u);
    if (then <= bound) {
      at(m, numbers, begin + (ends[i] - begin) * (value - bound) / (value - then), u);
      return 1;
    }
    begin = ends[i];
    value = then;
  }
  for (int c = 0; c < m; ++c) sizes += fabs(a[c]);
  return value - bound <= tolerance * sizes;
}
