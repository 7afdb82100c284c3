/* The run from instant to instant: integrate, sample, decide, apply, as the lockstep clock does. */

static double knot(const Run *r, I i, I number, I component) {
  I size = r->state_at[i + 1] - r->state_at[i];
  return r->half_width[i] * (2.0 * drawn(r->knot_key + 2 * i, number, component, size) - 1.0);
}

/* Draws the disturbance from t on, up to the first knot of any agent. */
static void draw_line(Run *r) {
  double t = r->t;
  r->line_begin = t;
  r->line_end = INFINITY;
  for (I i = 0; i < r->agents; ++i) {
    double every = r->every[i], last = floor(t / every);
    if ((last + 1.0) * every <= t) last += 1.0;
    double begin = last * every, end = (last + 1.0) * every;
    for (I s = r->state_at[i]; s < r->state_at[i + 1]; ++s) {
      double here = knot(r, i, (I)last, s - r->state_at[i]);
      double there = knot(r, i, (I)last + 1, s - r->state_at[i]);
      r->slope[s] = (there - here) / (end - begin);
      r->phi[s] = here + r->slope[s] * (t - begin);
    }
    if (end < r->line_end) r->line_end = end;
  }
}

void begin(Run *r) { draw_line(r); }

/* Steps all agents of one equation of motion, and returns whether all stays finite. */
static int move_kind(Run *r, I kind, I count, const double *phi, double dt, double *x, double *p) {
  I n = r->state_at[r->agents], d = r->axes, from = r->kind_at[kind],
    rows = r->kind_at[kind + 1] - from;
  I of = r->kind_agent[from], size = r->state_at[of + 1] - r->state_at[of];
  I inputs = r->input_at[of + 1] - r->input_at[of];
  double *row = r->scratch, *after = r->scratch + rows * (3 * size + inputs + 1);
  for (I a = from; a < from + rows; ++a) {
    I at = r->state_at[r->kind_agent[a]];
    memcpy(row, r->x + at, size * sizeof(double));
    memcpy(row += size, r->u + r->input_at[r->kind_agent[a]], inputs * sizeof(double));
    memcpy(row += inputs, phi + at, size * sizeof(double));
    memcpy(row += size, r->slope + at, size * sizeof(double));
    *(row += size) = dt;
    ++row;
  }
  r->motion[kind * MOST_IN_SEGMENT + count - 1](r->scratch, after, rows);
  for (I a = from; a < from + rows; ++a)
    for (I s = 0; s < count; ++s) {
      I i = r->kind_agent[a];
      for (I c = 0; c < size; ++c)
        if (!(fabs(after[c]) <= LARGEST)) return 0;
      for (I c = size; c < size + d; ++c)
        if (!isfinite(after[c])) return 0;
      memcpy(x + s * n + r->state_at[i], after, size * sizeof(double));
      memcpy(p + (s * r->agents + i) * d, after + size, d * sizeof(double));
      after += size + d;
    }
  return 1;
}

static int integrate(Run *r, double until) {
  I n = r->state_at[r->agents], m = r->input_at[r->agents], axes = r->agents * r->axes;
  while (r->t < until) {
    I s = r->segments, knot = r->line_end <= r->t;
    if (s == r->most_segments) return FULL;
    if (knot) draw_line(r);
    double begin = r->t, stop = until < r->line_end ? until : r->line_end;
    double steps = ceil((stop - begin) / r->step);
    I count = steps < MOST_IN_SEGMENT ? (I)steps : MOST_IN_SEGMENT;
    double *phi = r->segment_phi + s * n, end = begin + (double)count * r->step;
    r->t = stop < end ? stop : end;
    double dt = (r->t - begin) / (double)count;
    for (I c = 0; c < n; ++c) phi[c] = r->phi[c] + r->slope[c] * (begin - r->line_begin);
    memcpy(r->segment_slope + s * n, r->slope, n * sizeof(double));
    memcpy(r->segment_u + s * m, r->u, m * sizeof(double));
    memcpy(r->segment_start + s * n, r->x, n * sizeof(double));
    double *x = r->segment_x + s * MOST_IN_SEGMENT * n,
           *p = r->segment_p + s * MOST_IN_SEGMENT * axes;
    for (I kind = 0; kind < r->kinds; ++kind)
      if (!move_kind(r, kind, count, phi, dt, x, p)) return NOT_FINITE;
    memcpy(r->x, x + (count - 1) * n, n * sizeof(double));
    memcpy(r->p, p + (count - 1) * axes, axes * sizeof(double));
    r->segment_t[s] = begin;
    r->segment_dt[s] = dt;
    r->segment_steps[s] = count;
    r->segment_knot[s] = knot;
    ++r->segments;
  }
  return GOES_ON;
}

static void look_around(const Run *r, I i, I *seen, I *hearers) {
  I d = r->axes;
  for (I l = 0; l < r->agents; ++l) {
    double square = 0.0;
    for (I c = 0; c < d; ++c) {
      double off = r->p[l * d + c] - r->p[i * d + c];
      square += off * off;
    }
    seen[l] = !r->limited || square <= r->reach[i];
    hearers[l] = r->hears[l * r->agents + i] && (!r->limited || (seen[l] && square <= r->reach[l]));
  }
}

/* Whether agent i counts on what it received of l, for an input that takes effect at t. No lie is
   eligible, so that each is within U_l. */
static int believes(const Run *r, I i, I l, double t) {
  I link = i * r->agents + l;
  double since = r->received_t[link];
  if (r->received[link] < 0) return 0;
  if (r->information == 0) return t - since <= r->silence;
  return r->information == 1 && t < since + r->unchanged[l] - INSTANT;
}

/* The age of each received input that agent i's row used, in the order in which they came. */
static int report_ages(Run *r, I i, double t, const I *believed) {
  I rank = -1, n = r->agents;
  for (;;) {
    I next = -1;
    for (I l = 0; l < n; ++l)
      if (believed[l] && r->received[i * n + l] > rank &&
          (next < 0 || r->received[i * n + l] < r->received[i * n + next]))
        next = l;
    if (next < 0) return GOES_ON;
    rank = r->received[i * n + next];
    int counts = (int)r->pairwise;
    for (I c = r->terms->input_at[next]; c < r->terms->input_at[next + 1]; ++c)
      if (r->terms->c[c] != 0.0) counts = 1;
    if (!counts) continue;
    if (r->ages == r->most_ages) return NO_ROOM;
    r->age_of[r->ages] = next;
    r->age[r->ages++] = t - r->received_t[i * n + next];
  }
}

static int filter(Run *r, I i, double t, const I *seen, const double *wish, I step, I *order) {
  Terms *w = r->terms;
  I believed[MOST_AGENTS], m = w->input_at[i + 1] - w->input_at[i];
  double *u = r->step_u + step * MOST_INPUTS;
  r->step_margin[step] = NAN;
  if (r->adversary[i]) {
    clip(w, i, wish, u);
    r->step_origin[step] = ATTACK;
    r->step_residual[step] = 0.0;
    return GOES_ON;
  }
  for (I l = 0; l < r->agents; ++l) believed[l] = seen[l] && believes(r, i, l, t + r->latency);
  int failed = report_ages(r, i, t, believed);
  if (failed) return failed;
  if (r->pairwise)
    return decide_pairs(r, i, pair_rows(r, i, t + r->latency, seen, believed), wish, step);
  double bound = paper_bound(r, w, i, seen, believed, order);
  if ((failed = decide(r, w, i, bound, wish, u, &r->step_origin[step]))) return failed;
  double residual = inner(m, w->c + w->input_at[i], u) - bound;
  residual = FAR > residual ? FAR : residual;
  int reported = fabs(residual) <= LARGEST;
  r->step_residual[step] = reported ? residual : NAN;
  r->step_margin[step] = r->margin[i];
  if (!reported || residual >= -AT_BOUND * (1.0 + fabs(bound))) {
    I other = weightiest(w, i, seen);
    if (other >= 0) r->binding_of[r->bindings++] = other;
  }
  return GOES_ON;
}

/* Agent i's sample at t, its answer, and its broadcast. */
static int sample(Run *r, I i, double t, I number) {
  I seen[MOST_AGENTS], hearers[MOST_AGENTS], first[MOST_AGENTS], last[MOST_AGENTS],
      order[MOST_AGENTS];
  I step = r->steps, m = r->input_at[i + 1] - r->input_at[i], k = r->k[i]++;
  double *wish = r->step_wish + step * MOST_INPUTS, size = 0.0;
  look_around(r, i, seen, hearers);
  existing(r, i, t, seen, first, last);
  r->next_sample[i] = r->next_sample[i] + r->period[i] +
                      r->jitter[i] * (2.0 * drawn(r->clock_key + 2 * i, k, 0, 1) - 1.0);
  r->newest_step[i] = number;
  r->due[i] = t + r->latency;
  take_contacts(r, i, k, t, seen, hearers);
  int failed = advance_inbox(r, i, t, first, last);
  if (failed) return failed;
  take_state(r->terms, i, r);
  if (r->adversary[i] ? r->law[i] == WORST : !r->pairwise) compute_terms(r->terms, seen);
  if ((failed = wish_of(r, i, t, seen, wish, order))) return failed;
  for (I c = 0; c < m; ++c) size += fabs(wish[c]);
  if (!(size <= LARGEST)) return NOT_FINITE;
  if ((failed = filter(r, i, t, seen, wish, step, order))) return failed;
  I said = i * RING + k % RING;
  r->said_t[said] = t + r->latency;
  memcpy(r->said_u + said * MOST_INPUTS, r->step_u + step * MOST_INPUTS,
         MOST_INPUTS * sizeof(double));
  r->step_i[step] = i;
  r->step_k[step] = k;
  r->step_t[step] = t;
  r->step_rejected[step] = r->rejected[i];
  r->step_ages[step] = r->ages;
  r->step_fates[step] = r->fates;
  r->step_bindings[step] = r->bindings;
  ++r->steps;
  return GOES_ON;
}

static double next_event(const Run *r) {
  double t = INFINITY;
  for (I i = 0; i < r->agents; ++i) {
    if (r->next_sample[i] < t) t = r->next_sample[i];
    if (r->due[i] < t) t = r->due[i];
  }
  return t;
}

static void apply(Run *r, double t) {
  for (I i = 0; i < r->agents; ++i) {
    if (!(r->due[i] <= t)) continue;
    const double *u = r->pending + i * MOST_INPUTS;
    memcpy(r->u + r->input_at[i], u, (r->input_at[i + 1] - r->input_at[i]) * sizeof(double));
    r->due[i] = INFINITY;
    r->applied_step[r->applied++] = r->newest_step[i];
  }
}

static void end_instant(Run *r, double t) {
  I n = r->instants++;
  r->instant_t[n] = t;
  r->instant_steps[n] = r->steps;
  r->instant_applied[n] = r->applied;
  r->instant_segments[n] = r->segments;
}

/* Goes on until the results are full, or the run is over. */
int advance(Run *r) {
  for (;;) {
    double t = next_event(r), until = t < r->duration ? t : r->duration;
    if (r->instants == r->most_instants || r->steps + r->agents > r->most_steps ||
        2 * r->fates > r->most_fates || 2 * r->bindings > r->most_bindings)
      return FULL;
    int failed = integrate(r, until);
    if (failed) return failed;
    if (!(t < r->duration)) {
      end_instant(r, r->duration);
      return OVER;
    }
    I due[MOST_AGENTS];
    for (I i = 0; i < r->agents; ++i) due[i] = r->next_sample[i] <= t;
    for (I i = 0; i < r->agents; ++i) {
      if (!due[i]) continue;
      if ((failed = sample(r, i, t, r->first_step + r->steps))) return failed;
      memcpy(r->pending + i * MOST_INPUTS, r->step_u + (r->steps - 1) * MOST_INPUTS,
             MOST_INPUTS * sizeof(double));
    }
    apply(r, t);
    end_instant(r, t);
  }
}
