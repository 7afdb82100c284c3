/* One row for each pair of an agent: rows/pairs.py, rows/decision.decide_pairs and rows/qp.py. */

static const double MOST_BOUND = 1e30;

/* Agent i's rows, kind by kind as they come first; returns their number. */
static I pair_rows(Run *r, I i, double t, const I *seen, const I *believed) {
  const Terms *w = r->terms;
  I count = 0, q = w->degree, m = w->input_at[i + 1] - w->input_at[i], end = r->row_at[i + 1];
  for (I p = r->row_at[i]; p < end; ++p) {
    I o = r->row_other[p], link = i * r->agents + o, half = 0;
    r->row_kind[p] = -1;
    if (o < r->agents ? !seen[o] : w->around[o - r->agents] == 0.0) continue;
    if (o < r->agents && r->shares[o])
      half = t <= r->silence || (r->received[link] >= 0 && t - r->received_t[link] <= r->silence);
    r->row_kind[p] = half ? r->row_half[p] : r->row_whole[p];
  }
  for (I first = r->row_at[i]; first < end; ++first) {
    I kind = r->row_kind[first];
    for (I p = first; kind >= 0 && p < end; ++p) {
      if (r->row_kind[p] != kind) continue;
      I o = r->row_other[p], half = r->kind_half[kind];
      double *row = w->rows, *values = w->values, bound;
      for (I c = 0; c < r->kind_width[kind]; ++c)
        row[c] = w->numbers[r->row_index[r->row_index_at[p] + c]];
      r->row_function[kind](row, values, 1);
      double unforced = values[q], most = values[q + 1], margin = values[q + 2];
      bound = -(half ? 0.5 * unforced + margin : unforced + most + margin);
      if (!half && o < r->agents && believed[o])
        bound += most - inner(w->input_at[o + 1] - w->input_at[o], values + q + 3 + m,
                              r->received_u + (i * r->agents + o) * MOST_INPUTS);
      memcpy(r->row_a + count * m, values + q + 3, m * sizeof(double));
      r->row_bound[count] = bound;
      r->row_margin[count] = margin;
      r->row_of[count++] = o;
      r->row_kind[p] = -1;
    }
  }
  return count;
}

static int keeps_rows(const Run *r, I m, I count, const double *u) {
  for (I k = 0; k < count; ++k)
    if (!(inner(m, r->row_a + k * m, u) <= r->row_bound[k])) return 0;
  return 1;
}

/* The input nearest to a wish that keeps U and all rows; 0 without one. */
static int nearest_input(const Run *r, I i, I count, const double *wish, double *u) {
  const Terms *w = r->terms;
  I at = w->input_at[i], m = w->input_at[i + 1] - at, faces = r->face_count[i], all = faces + count;
  double *G = r->program, *g = G + all * m, *numbers = g + all, size = 0.0, largest = 0.0;
  const double *metric = w->metric + at, *face = r->faces + i * 2 * MOST_INPUTS * FACE;
  for (I k = 0; k < all; ++k) {
    const double *a = k < faces ? face + k * FACE : r->row_a + (k - faces) * m;
    double bound = k < faces ? a[MOST_INPUTS] : r->row_bound[k - faces];
    for (I c = 0; c < m; ++c) G[k * m + c] = a[c] / sqrt(metric[c]);
    double length = sqrt(inner(m, G + k * m, G + k * m)), scale = length == 0.0 ? 1.0 : length;
    g[k] = bound / scale;
    if (g[k] > MOST_BOUND) g[k] = MOST_BOUND;
    if ((length == 0.0 && bound < 0.0) || !(length < INFINITY) || !(g[k] > -MOST_BOUND)) return 0;
    for (I c = 0; c < m; ++c) G[k * m + c] /= scale;
  }
  for (I c = 0; c < m; ++c) {
    double low = w->low[at + c] * w->low[at + c], high = w->high[at + c] * w->high[at + c];
    size += (high > low ? high : low) * metric[c];
    numbers[c] = sqrt(metric[c]) * wish[c];
    if (fabs(numbers[c]) > largest) largest = fabs(numbers[c]);
  }
  size = sqrt(size);
  double farthest = FARTHEST * (size > 1.0 ? size : 1.0);
  if (farthest < largest)
    for (I c = 0; c < m; ++c) numbers[c] *= farthest / largest;
  if (r->nearest_point((int)m, (int)all, numbers, G, g, size, -1, r->limits, r->row_numbers) < 0)
    return 0;
  for (I c = 0; c < m; ++c) u[c] = numbers[m + c] / sqrt(metric[c]);
  clip(w, i, u, u);
  return 1;
}

/* Whether row k counts in the least violation: without a known margin somewhere, only such rows. */
static int counts(const Run *r, I k, int unknown) {
  return !unknown || r->row_bound[k] == -INFINITY;
}

/* The input of U with the least worst violation of the rows: rows/least_violation.py. NOT_FINITE
   if numbers are too large for it. */
static int least_violation(const Run *r, I i, I count, double *u) {
  const Terms *w = r->terms;
  I m = w->input_at[i + 1] - w->input_at[i], corners = w->corner_at[i + 1] - w->corner_at[i];
  const double *corner = w->corners + w->corner_at[i],
               *face = r->faces + i * 2 * MOST_INPUTS * FACE;
  double *table = r->program, *row = table, highest = -INFINITY, lowest = INFINITY,
         best[MOST_INPUTS + 1];
  double least_worst = INFINITY;
  int unknown = 0;
  corners /= m;
  for (I k = 0; k < count; ++k) unknown |= r->row_bound[k] == -INFINITY;
  for (I k = 0; k < count; ++k) {
    double least = INFINITY, bound = unknown ? 0.0 : r->row_bound[k];
    if (!(fabs(bound) <= MOST_BOUND) || isnan(r->row_bound[k])) return NOT_FINITE;
    for (I c = 0; c < m; ++c)
      if (!(fabs(r->row_a[k * m + c]) <= MOST_BOUND)) return NOT_FINITE;
    if (!counts(r, k, unknown)) continue;
    for (I v = 0; v < corners; ++v) {
      double residual = inner(m, r->row_a + k * m, corner + v * m) - bound;
      if (residual < least) least = residual;
    }
    if (least > highest) highest = least;
  }
  for (I k = 0; k < count; ++k) {
    double most = -INFINITY, bound = unknown ? 0.0 : r->row_bound[k];
    if (!counts(r, k, unknown)) continue;
    for (I v = 0; v < corners; ++v) {
      double residual = inner(m, r->row_a + k * m, corner + v * m) - bound;
      if (residual > most) most = residual;
    }
    if (!(most >= highest)) continue;
    memcpy(row, r->row_a + k * m, m * sizeof(double));
    row[m] = -1.0;
    row[m + 1] = bound;
    if (bound < lowest) lowest = bound;
    row += m + 2;
  }
  I binding = (row - table) / (m + 2);
  for (I k = 0; k < binding; ++k) table[k * (m + 2) + m + 1] -= lowest;
  for (I f = 0; f < r->face_count[i]; ++f, row += m + 2, face += FACE) {
    memcpy(row, face, m * sizeof(double));
    row[m] = 0.0;
    row[m + 1] = face[MOST_INPUTS];
  }
  if (!r->least_vertex((int)m + 1, (int)(binding + r->face_count[i]), table, best))
    for (I v = 0; v < corners; ++v, corner += m) {
      double worst = -INFINITY;
      for (I k = 0; k < count; ++k) {
        double bound = unknown ? 0.0 : r->row_bound[k];
        double residual = inner(m, r->row_a + k * m, corner) - bound;
        if (counts(r, k, unknown) && residual > worst) worst = residual;
      }
      if (worst < least_worst) {
        least_worst = worst;
        memcpy(best, corner, m * sizeof(double));
      }
    }
  for (I c = 0; c < m; ++c) u[c] = best[c] + 0.0;
  return GOES_ON;
}

/* Decides as decide_pairs does, and reports on the step. */
static int decide_pairs(Run *r, I i, I count, const double *wish, I step) {
  const Terms *w = r->terms;
  I m = w->input_at[i + 1] - w->input_at[i], worst = -1;
  double *u = r->step_u + step * MOST_INPUTS, largest = 0.0;
  r->step_origin[step] = QP;
  clip(w, i, wish, u);
  if (!keeps_rows(r, m, count, u) && !nearest_input(r, i, count, wish, u)) {
    int failed = least_violation(r, i, count, u);
    if (failed) return failed;
    r->step_origin[step] = keeps_rows(r, m, count, u) ? SOLVER_FAILED : BACKUP;
  }
  for (I k = 0; k < count; ++k) {
    r->residual[k] = inner(m, r->row_a + k * m, u) - r->row_bound[k];
    if (isnan(r->residual[k])) return NOT_FINITE;
    if (worst < 0 || r->residual[k] > largest) largest = r->residual[worst = k];
  }
  r->step_margin[step] = NAN;
  r->step_residual[step] = FAR;
  if (worst < 0 || largest <= FAR) return GOES_ON;
  if (fabs(r->row_margin[worst]) <= LARGEST) r->step_margin[step] = r->row_margin[worst];
  r->step_residual[step] = fabs(largest) <= LARGEST ? largest : NAN;
  for (I k = 0; k < count; ++k)
    if (!(r->residual[k] < -AT_BOUND * (1.0 + fabs(r->row_bound[k]))))
      r->binding_of[r->bindings++] = r->row_of[k];
  return GOES_ON;
}
