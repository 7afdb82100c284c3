/* Goals, laws and attacks: theory/laws explains them. Their formulas are kernels. */

enum { PIECES, PLACES, STAY };
enum { STEERED, PURSUE, CHASE, WORST, SCRIPT };

/* Position, velocity and acceleration of agent i's goal at t, 3 d numbers. */
static void goal_at(Run *r, I i, double t, double *goal) {
  I d = r->axes, first = r->piece_at[i], last = r->piece_at[i + 1] - 1, piece = last;
  memset(goal, 0, 3 * d * sizeof(double));
  if (r->goal[i] == STAY) {
    memcpy(goal, r->p + i * d, d * sizeof(double));
  } else if (r->goal[i] == PLACES) {
    for (piece = first + r->reached[i]; piece < last; ++piece) {
      double square = 0.0;
      for (I c = 0; c < d; ++c) {
        double off = r->term[r->term_at[piece] * 3 * d + c] - r->p[i * d + c];
        square += off * off;
      }
      if (sqrt(square) > r->tolerance[i]) break;
    }
    r->reached[i] = piece - first;
    memcpy(goal, r->term + r->term_at[piece] * 3 * d, d * sizeof(double));
  } else {
    while (piece > first && t < r->piece_begin[piece]) --piece;
    I from = r->term_at[piece], terms = r->term_at[piece + 1] - from;
    double s = (t - r->piece_begin[piece]) / r->piece_scale[piece];
    memcpy(goal, r->term + from * 3 * d, 3 * d * sizeof(double));
    for (I k = from + 1; k < from + terms; ++k)
      for (I c = 0; c < 3 * d; ++c) goal[c] = goal[c] * s + r->term[k * 3 * d + c];
  }
}

/* The nearest normal agent in sight; -1 without one. */
static I nearest_normal(const Run *r, I i, const I *seen) {
  I nearest = -1, d = r->axes;
  double least = 0.0;
  for (I l = 0; l < r->agents; ++l) {
    double square = 0.0;
    if (r->adversary[l] || !seen[l]) continue;
    for (I c = 0; c < d; ++c) {
      double off = r->p[l * d + c] - r->p[i * d + c];
      square += off * off;
    }
    if (nearest < 0 || square < least) {
      nearest = l;
      least = square;
    }
  }
  return nearest;
}

/* Guards a chaser's wish against its team and obstacles: attacks._Team. */
static int guarded(Run *r, I i, const I *seen, double *wish, I *order) {
  Terms *team = r->team + i;
  I l = r->team_member[i], origin;
  double u[MOST_INPUTS];
  take_state(team, l, r);
  compute_terms(team, seen);
  double bound = shared_bound(team, l, r->team_margin[i], seen, order);
  int failed = decide(r, team, l, bound, wish, u, &origin);
  memcpy(wish, u, sizeof u);
  return failed;
}

static int wish_of(Run *r, I i, double t, const I *seen, double *wish, I *order) {
  I d = r->axes, target, at, size = r->state_at[i + 1] - r->state_at[i];
  double *row = r->scratch, goal[9];
  const Kernel *kernel = r->wish + i * (r->agents + 1);
  memcpy(row, r->x + r->state_at[i], size * sizeof(double));
  switch (r->law[i]) {
    case STEERED:
      goal_at(r, i, t, goal);
      memcpy(row + size, goal, r->goal_numbers[i] * sizeof(double));
      kernel[r->agents](row, wish, 1);
      break;
    case PURSUE:
      target = nearest_normal(r, i, seen);
      memcpy(row + size, r->p + (target < 0 ? i : target) * d, d * sizeof(double));
      kernel[r->agents](row, wish, 1);
      break;
    case CHASE:
      target = r->target[i];
      if (target < 0 || !seen[target]) target = nearest_normal(r, i, seen);
      if (target >= 0)
        memcpy(row + size, r->x + r->state_at[target],
               (r->state_at[target + 1] - r->state_at[target]) * sizeof(double));
      kernel[target < 0 ? r->agents : target](row, wish, 1);
      if (r->team[i].degree) return guarded(r, i, seen, wish, order);
      break;
    case WORST:
      extreme_corner(r->terms, i, -1.0, wish);
      break;
    case SCRIPT:
      at = r->script_at[i + 1] - 1;
      while (at > r->script_at[i] && t < r->script_begin[at]) --at;
      memcpy(wish, r->script + at * MOST_INPUTS, MOST_INPUTS * sizeof(double));
      break;
  }
  return GOES_ON;
}
