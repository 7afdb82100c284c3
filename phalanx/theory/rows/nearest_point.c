/* The nearest point of {G v <= g}: the same operations in the same order as nearest_point.py, which
   explains them. Compiled without fused operations, so that the bits are the same too. */
#include <math.h>
#include <string.h>

#define M 16 /* most inputs */

typedef struct {
  int m, k;
  const double *n, *G, *g;
  double primal, dual, independent, near;
  double *slack; /* of the point that was checked last, k numbers */
  int *within;   /* rows near it */
} Program;

typedef struct {
  double v[M], multipliers[M], factor[M][M], near;
} Optimum;

static double inner(int m, const double *a, const double *b) {
  double total = 0.0;
  for (int c = 0; c < m; ++c) total += a[c] * b[c];
  return total;
}

static double sum_of_sizes(int m, const double *a) {
  double total = 0.0;
  for (int c = 0; c < m; ++c) total += fabs(a[c]);
  return total;
}

static int factorise(const Program *p, int size, const int *rows, double factor[M][M]) {
  if (size > p->m) return 0;
  for (int i = 0; i < size; ++i) {
    const double *a = p->G + (size_t)rows[i] * p->m;
    for (int j = 0; j < i; ++j) {
      const double *b = p->G + (size_t)rows[j] * p->m;
      factor[i][j] = (inner(p->m, a, b) - inner(j, factor[i], factor[j])) / factor[j][j];
    }
    double square = inner(p->m, a, a) - inner(i, factor[i], factor[i]);
    if (!(square > p->independent)) return 0;
    factor[i][i] = sqrt(square);
  }
  return 1;
}

static void solve(int size, double factor[M][M], const double *right, double *x) {
  for (int i = 0; i < size; ++i) x[i] = (right[i] - inner(i, factor[i], x)) / factor[i][i];
  for (int i = size - 1; i >= 0; --i) {
    double below = 0.0;
    for (int j = i + 1; j < size; ++j) below += factor[j][i] * x[j];
    x[i] = (x[i] - below) / factor[i][i];
  }
}

static void move(const Program *p, double *v, int size, const int *rows, const double *steps) {
  for (int i = 0; i < size; ++i)
    for (int c = 0; c < p->m; ++c) v[c] -= steps[i] * p->G[(size_t)rows[i] * p->m + c];
}

static int project(const Program *p, int size, const int *rows, Optimum *o) {
  if (!factorise(p, size, rows, o->factor)) return 0;
  memcpy(o->v, p->n, sizeof(double) * p->m);
  for (int i = 0; i < size; ++i) o->multipliers[i] = 0.0;
  for (int round = 0; round < 2; ++round) {
    double right[M], step[M];
    for (int i = 0; i < size; ++i)
      right[i] = inner(p->m, p->G + (size_t)rows[i] * p->m, o->v) - p->g[rows[i]];
    solve(size, o->factor, right, step);
    for (int i = 0; i < size; ++i) o->multipliers[i] += step[i];
    move(p, o->v, size, rows, step);
  }
  return 1;
}

static int passes(const Program *p, int size, const int *rows, Optimum *o) {
  if (!project(p, size, rows, o)) return 0;
  double least = -p->dual * (1.0 + sum_of_sizes(size, o->multipliers));
  for (int i = 0; i < size; ++i)
    if (o->multipliers[i] < least) return 0;
  for (int j = 0; j < p->k; ++j) {
    p->slack[j] = p->g[j] - inner(p->m, p->G + (size_t)j * p->m, o->v);
    if (p->slack[j] < -p->primal * (1.0 + fabs(p->g[j]))) return 0;
  }
  double total = 0.0;
  for (int i = 0; i < size; ++i) total += fabs(o->multipliers[i] * (1.0 + fabs(p->g[rows[i]])));
  o->near = p->near * sqrt(1.0 + total);
  return 1;
}

static int near_rows(const Program *p, const Optimum *o) {
  int count = 0;
  for (int j = 0; j < p->k; ++j)
    if (p->slack[j] <= o->near) p->within[count++] = j;
  return count;
}

static int strict(const Program *p, int size, Optimum *o) {
  double determinant = 1.0;
  for (int i = 0; i < size; ++i) determinant *= o->factor[i][i] * o->factor[i][i];
  double least = o->near / sqrt(determinant);
  if (near_rows(p, o) != size) return 0;
  for (int i = 0; i < size; ++i)
    if (!(o->multipliers[i] > least)) return 0;
  return 1;
}

static void sort(int size, int *rows) {
  for (int i = 1; i < size; ++i)
    for (int j = i; j > 0 && rows[j - 1] > rows[j]; --j) {
      int row = rows[j];
      rows[j] = rows[j - 1];
      rows[j - 1] = row;
    }
}

/* Returns whether it proves that no point exists. */
static int iterate(const Program *p, double size_of_v, int most_steps, int *rows, int *size) {
  Optimum o;
  double change[M], right[M], direction[M], largest = 0.0;
  int entering = -1, count = 0;
  for (int j = 0; j < p->k; ++j) largest = fmax(largest, p->primal * (1.0 + fabs(p->g[j])));
  while (most_steps-- > 0) {
    if (entering < 0) {
      double most = -INFINITY;
      if (!project(p, count, rows, &o)) break;
      for (int j = 0; j < p->k; ++j) {
        double excess = inner(p->m, p->G + (size_t)j * p->m, o.v) - p->g[j];
        excess -= p->primal * (1.0 + fabs(p->g[j]));
        if (excess > most) most = excess, entering = j;
      }
      if (!(most > 0.0)) break;
    }
    const double *a = p->G + (size_t)entering * p->m;
    if (!factorise(p, count, rows, o.factor)) break;
    for (int i = 0; i < count; ++i) right[i] = inner(p->m, p->G + (size_t)rows[i] * p->m, a);
    solve(count, o.factor, right, change);
    memcpy(direction, a, sizeof(double) * p->m);
    move(p, direction, count, rows, change);
    double square = inner(p->m, direction, direction), first = INFINITY;
    double violation = inner(p->m, a, o.v) - p->g[entering];
    int leaving = -1;
    for (int i = 0; i < count; ++i)
      if (change[i] > 0.0 && o.multipliers[i] / change[i] < first)
        first = o.multipliers[i] / change[i], leaving = i;
    double whole = square > p->independent ? violation / square : INFINITY;
    double step = whole < first ? whole : first;
    if (step == INFINITY) {
      double error = sqrt(square) * (size_of_v + sqrt(inner(p->m, o.v, o.v)));
      *size = 0;
      return violation > (1.0 + sum_of_sizes(count, change)) * largest + error;
    }
    if (whole < INFINITY)
      for (int c = 0; c < p->m; ++c) o.v[c] -= step * direction[c];
    for (int i = 0; i < count; ++i) o.multipliers[i] -= step * change[i];
    if (step == whole) {
      rows[count++] = entering;
      entering = -1;
    } else {
      for (int i = leaving + 1; i < count; ++i)
        rows[i - 1] = rows[i], o.multipliers[i - 1] = o.multipliers[i];
      --count;
    }
  }
  sort(count, rows);
  *size = count;
  return 0;
}

/* At most most_sets + 1. */
static int count_sets(int rows, int m, int most_sets) {
  double total = 1.0, sets = 1.0;
  for (int size = 1; size <= m && size <= rows && total <= most_sets; ++size) {
    sets = sets * (rows - size + 1) / size;
    total += sets;
  }
  return total > most_sets ? most_sets + 1 : (int)total;
}

/* The first set of rows of `pool` that passes, or -1. */
static int first_that_passes(const Program *p, int count, const int *pool, Optimum *o, int *rows) {
  int index[M];
  for (int size = 0; size <= p->m && size <= count; ++size) {
    for (int i = 0; i < size; ++i) index[i] = i;
    for (;;) {
      for (int i = 0; i < size; ++i) rows[i] = pool[index[i]];
      if (passes(p, size, rows, o)) return size;
      int i = size - 1;
      while (i >= 0 && index[i] == count - size + i) --i;
      if (i < 0) break;
      ++index[i];
      for (int j = i + 1; j < size; ++j) index[j] = index[j - 1] + 1;
    }
  }
  return -1;
}

/* The number of the point's rows, or -1 if there is none. With hint_size >= 0, rows holds a hint,
   and the point is returned only if these rows pass strictly.
   numbers: n, then room for v and for k slacks; rows: room for m + 2 k integers;
   limits: primal, dual, independent, near, most sets, most steps. */
int nearest_point(int m, int k, double *numbers, const double *G, const double *g, double size_of_v,
                  int hint_size, const double *limits, int *rows) {
  int *within = rows + m, *near = within + k, size = hint_size, count = k;
  double *v = numbers + m;
  Program p = {m, k, numbers, G, g, limits[0], limits[1], limits[2], limits[3], v + m, within};
  Optimum o;
  if (hint_size >= 0) {
    if (!passes(&p, size, rows, &o) || !strict(&p, size, &o)) return -1;
  } else {
    if (iterate(&p, size_of_v, (int)limits[5], rows, &size)) return -1;
    int passed = passes(&p, size, rows, &o);
    if (passed) count = near_rows(&p, &o);
    for (int j = 0; j < count; ++j) near[j] = passed ? within[j] : j;
    if (count_sets(count, m, (int)limits[4]) <= (int)limits[4])
      size = first_that_passes(&p, count, near, &o, rows);
    else if (!passed)
      return -1;
  }
  if (size >= 0) memcpy(v, o.v, sizeof(double) * m);
  return size;
}
