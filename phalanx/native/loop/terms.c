/* Terms of h_tot, the input that they allow, and its backup: rows/by_jets.py, rows/decision.py. */

static const double FAR = -1e9, AUTHORITY = 0.01, TOLERANCE = 1e-6, FARTHEST = 1e6,
                    FLOOR_OF_SPAN = 0.01;

static const double LARGEST = 1e300, AT_BOUND = 1e-6, INSTANT = 1e-9;

static double inner(I m, const double *a, const double *b) {
  double total = 0.0;
  for (I c = 0; c < m; ++c) total += a[c] * b[c];
  return total;
}

static I place_of(const Terms *w, I pair, const double *numbers, double *row, I width) {
  for (I c = 0; c < width; ++c) row[c] = numbers[w->indices[w->index_at[pair] + c]];
  return width;
}

/* Jets of the pairs in sight, group by group; returns their number. */
static I jets_in_sight(Terms *w, const I *seen) {
  I shown = 0, end = 0;
  for (I g = 0; g < w->groups; ++g) {
    I rows = 0;
    for (I p = w->group_at[g]; p < w->group_at[g + 1]; ++p) {
      I b = w->second[p];
      if (!seen[w->agent[w->first[p]]]) continue;
      if (b < w->members ? !seen[w->agent[b]] : w->around[b - w->members] == 0.0) continue;
      place_of(w, p, w->numbers, w->rows + rows * w->width[g], w->width[g]);
      w->shown[shown] = p;
      w->value_at[shown++] = end + rows++ * w->results[g];
    }
    if (rows) w->jets[g](w->rows, w->values + end, rows);
    end += rows * w->results[g];
  }
  return shown;
}

/* Takes the state, and the obstacles in sight of member l. */
static void take_state(Terms *w, I l, const Run *r) {
  I states = w->state_at[w->members];
  for (I b = 0; b < w->members; ++b)
    memcpy(w->numbers + w->state_at[b], r->x + r->state_at[w->agent[b]],
           (w->state_at[b + 1] - w->state_at[b]) * sizeof(double));
  for (I o = 0; o < w->obstacles; ++o) w->around[o] = 1.0;
  if (w->near[l]) {
    I size = w->state_at[l + 1] - w->state_at[l], rest = w->parameters;
    memcpy(w->rows, w->numbers + w->state_at[l], size * sizeof(double));
    memcpy(w->rows + size, w->numbers + states, rest * sizeof(double));
    w->near[l](w->rows, w->around, 1);
  }
}

/* Puts the chain, c, least and most of the members in sight into w. */
static void compute_terms(Terms *w, const I *seen) {
  I q = w->degree, shown = jets_in_sight(w, seen), room = 0;
  while (w->room[room] < shown) ++room;
  for (I s = 0; s < w->room[room]; ++s)
    for (I k = 0; k <= q; ++k)
      w->columns[s * (q + 1) + k] = s < shown ? w->values[w->value_at[s] + k] : k ? 0.0 : FAR;
  w->composition[room](w->columns, w->chain, 1);
  memset(w->c, 0, w->input_at[w->members] * sizeof(double));
  for (I s = 0; s < shown; ++s) {
    const double *force = w->values + w->value_at[s] + q + 1;
    double weight = w->chain[q + 1 + s * q + q - 1];
    for (I f = w->force_at[w->shown[s]]; f < w->force_at[w->shown[s] + 1]; ++f)
      w->c[w->force_input[f]] += *force++ * weight;
  }
  for (I b = 0; b < w->members; ++b) {
    if (!seen[w->agent[b]]) continue;
    I m = w->input_at[b + 1] - w->input_at[b], size = w->corner_at[b + 1] - w->corner_at[b];
    double ends[2];
    memcpy(w->rows, w->c + w->input_at[b], m * sizeof(double));
    memcpy(w->rows + m, w->corners + w->corner_at[b], size * sizeof(double));
    w->extremes[w->kind[b]](w->rows, ends, 1);
    w->least[b] = ends[0];
    w->most[b] = ends[1];
  }
}

/* The corner of member l's U with the least c u, times sign. */
static void extreme_corner(const Terms *w, I l, double sign, double *u) {
  I m = w->input_at[l + 1] - w->input_at[l];
  const double *c = w->c + w->input_at[l], *chosen = w->corners + w->corner_at[l];
  double least = sign * inner(m, chosen, c);
  for (const double *corner = chosen + m; corner < w->corners + w->corner_at[l + 1]; corner += m) {
    double value = sign * inner(m, corner, c);
    if (value < least) {
      least = value;
      chosen = corner;
    }
  }
  memcpy(u, chosen, m * sizeof(double));
}

static void clip(const Terms *w, I l, const double *from, double *u) {
  for (I c = w->input_at[l]; c < w->input_at[l + 1]; ++c, ++from, ++u) {
    double above = *from > w->low[c] ? *from : w->low[c];
    *u = above < w->high[c] ? above : w->high[c];
  }
}

enum { QP, SOLVER_FAILED, BACKUP, NO_AUTHORITY, ATTACK };

/* Member l's input nearest to its wish with c u <= bound, or its backup; NOT_FINITE without one. */
static int decide(const Run *r, const Terms *w, I l, double bound, const double *wish, double *u,
                  I *origin) {
  I m = w->input_at[l + 1] - w->input_at[l], at = w->input_at[l];
  double numbers[8 * MOST_INPUTS], largest = 0.0, size = 1.0;
  *origin = BACKUP;
  if (isnan(bound) || isnan(w->least[l])) return NOT_FINITE;
  if (w->least[l] <= bound) {
    *origin = QP;
    for (I c = 0; c < m; ++c) {
      double ends[2] = {fabs(w->low[at + c]), fabs(w->high[at + c])};
      if (fabs(wish[c]) > largest) largest = fabs(wish[c]);
      for (int e = 0; e < 2; ++e)
        if (ends[e] > size) size = ends[e];
      numbers[c] = wish[c];
      numbers[m + c] = w->metric[at + c];
      numbers[2 * m + c] = w->low[at + c];
      numbers[3 * m + c] = w->high[at + c];
      numbers[4 * m + c] = w->c[at + c];
    }
    double share = FARTHEST * size / largest;
    if (largest > FARTHEST)
      for (I c = 0; c < m; ++c) numbers[c] *= share < 1.0 ? share : 1.0;
    if (r->nearest((int)m, numbers, bound, TOLERANCE)) {
      memcpy(u, numbers + 5 * m, m * sizeof(double));
      return GOES_ON;
    }
    *origin = SOLVER_FAILED;
  } else if (w->most[l] - w->least[l] <= AUTHORITY) {
    clip(w, l, wish, u);
    *origin = NO_AUTHORITY;
    return GOES_ON;
  }
  extreme_corner(w, l, 1.0, u);
  return GOES_ON;
}

/* Calls f(l) for the members in sight kind by kind, in the order of terms.most: into `order`. */
static I by_kind(const Terms *w, const I *seen, I *order) {
  I count = 0;
  for (I l = 0; l < w->members; ++l) {
    int is_first = seen[w->agent[l]];
    for (I b = 0; b < l; ++b)
      if (seen[w->agent[b]] && w->kind[b] == w->kind[l]) is_first = 0;
    for (I b = l; is_first && b < w->members; ++b)
      if (seen[w->agent[b]] && w->kind[b] == w->kind[l]) order[count++] = b;
  }
  return count;
}

/* The bound of member l's share of a joint condition that all in sight keep: row.split_row. */
static double shared_bound(const Terms *w, I l, double margin, const I *seen, I *order) {
  double spans = 0.0, least = 0.0;
  I count = by_kind(w, seen, order);
  for (I b = 0; b < w->members; ++b)
    if (seen[w->agent[b]]) spans += w->most[b] - w->least[b] + FLOOR_OF_SPAN;
  for (I n = 0; n < count; ++n) least += w->least[order[n]];
  double share = (w->most[l] - w->least[l] + FLOOR_OF_SPAN) / spans;
  return w->least[l] + share * -(w->chain[w->degree] + margin + least);
}

/* Agent i's row c u <= bound, as printed; believed: 1 for each whose received input counts. */
static double paper_bound(const Run *r, const Terms *w, I i, const I *seen, const I *believed,
                          I *order) {
  double others = w->chain[w->degree] + r->margin[i];
  I count = by_kind(w, seen, order);
  for (I n = 0; n < count; ++n) {
    I l = order[n], m = w->input_at[l + 1] - w->input_at[l];
    if (believed[l])
      others += inner(m, w->c + w->input_at[l], r->received_u + (i * r->agents + l) * MOST_INPUTS);
    else if (l != i)
      others += w->most[l];
  }
  return -others;
}

/* The other of agent i's pair in sight with the largest h; -1 without one. */
static I weightiest(Terms *w, I i, const I *seen) {
  double largest = 0.0;
  I other = -1;
  for (I g = 0; g < w->groups; ++g)
    for (I p = w->group_at[g]; p < w->group_at[g + 1]; ++p) {
      I a = w->first[p], b = w->second[p];
      if ((a != i && b != i) || !seen[a] || (b < w->members && !seen[b])) continue;
      place_of(w, p, w->numbers, w->rows, w->width[g]);
      w->jets[g](w->rows, w->values, 1);
      if (other < 0 || w->values[0] > largest) {
        largest = w->values[0];
        other = a == i ? b : a;
      }
    }
  return other;
}
