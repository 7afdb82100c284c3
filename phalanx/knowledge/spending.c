/* The largest own part of each input towards each peer: the same operations in the same order as
   HoldPieces in spending.py, which explains them, and Cones.closing. Compiled without fused
   operations, so that the bits are the same too. */
#include <math.h>

#define D 3 /* most axes */

/* As NumPy has them: a NaN stays. */
static double larger(double a, double b) { return a >= b || a != a ? a : b; }
static double smaller(double a, double b) { return a <= b || a != a ? a : b; }

static double dot(int d, const double *a, const double *b) {
  double total = 0.0;
  for (int i = 0; i < d; ++i) total += a[i] * b[i];
  return total;
}

static double length(int d, const double *a) { return sqrt(dot(d, a, a)); }

static double closing(int d, const double *axis, double cosine, double sine, const double *v) {
  double along = -dot(d, axis, v), size = length(d, v), lateral[D];
  for (int i = 0; i < d; ++i) lateral[i] = v[i] + along * axis[i];
  return along >= cosine * size ? size : along * cosine + length(d, lateral) * sine;
}

/* q inputs, n cones of m pieces each, d axes.
   hold: drag, authority, longest, then k and the rate at the pieces' m + 1 ends;
   in: v, the inputs, then axis, cos and sin of the cones; out: room for q n numbers. */
void spending(int q, int n, int m, int d, const double *hold, const double *in, double *out) {
  const double *k = hold + 3, *rate = k + m + 1, *v = in, *inputs = v + d;
  const double *axis = inputs + q * d, *cosine = axis + n * m * d, *sine = cosine + n * m;
  for (int j = 0; j < q; ++j) {
    const double *u = inputs + j * d;
    double c[D], begin[D], end[D], *most = out + j * n;
    for (int i = 0; i < d; ++i) c[i] = u[i] - hold[0] * v[i];
    double change = length(d, c), across = dot(d, c, v);
    for (int p = 0; p < m; ++p) {
      for (int i = 0; i < d; ++i) {
        begin[i] = v[i] + c[i] * k[p];
        end[i] = v[i] + c[i] * k[p + 1];
      }
      double inner = across + change * change * k[p + 1], speed = length(d, end);
      double faster = speed > 0.0 ? inner / speed : change;
      faster = smaller(larger(faster, -change), change);
      double growth = inner / hold[1] + hold[2] * faster;
      growth *= growth > 0.0 ? rate[p] : rate[p + 1];
      for (int l = 0; l < n; ++l) {
        int cone = l * m + p;
        double first = closing(d, axis + cone * d, cosine[cone], sine[cone], begin);
        double last = closing(d, axis + cone * d, cosine[cone], sine[cone], end);
        double part = growth + larger(first, last);
        most[l] = p ? larger(most[l], part) : part;
      }
    }
  }
}
