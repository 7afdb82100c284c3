/* What link rules make of a message: network/loss.py and network/delay.py have them one by one. */

enum {
  LOSS,
  BURSTS,
  BY_DISTANCE,
  DUPLICATE,
  CORRUPT,
  CONSTANT,
  UNIFORM,
  JITTERED,
  FLOOR,
  REORDER,
  RATE,
  SLOT,
  TRACE
};

typedef struct {
  double after;
  int corrupt;
} Copy;

static double table_value(const double *table, double u) {
  double position = u * 4096.0, cell = floor(position);
  double low = table[(I)cell], high = table[(I)cell + 1];
  return low + (position - cell) * (high - low);
}

static double jitter_of(const double *n, const U *key, const double *table, I k) {
  I row = k;
  if (n[2] > 0.0)
    while (row > 0 && drawn(key + 2, row, 1, 2) < n[2]) --row;
  double u = drawn(key, row, 1, 2), quantile = n[3] ? table_value(table, u) : 2.0 * u - 1.0;
  double after = n[0] + n[1] * quantile;
  return after > 0.0 ? after : 0.0;
}

static int is_bad(const double *n, const U *key, I k) {
  I row = k;
  double u = drawn(key, row, 0, 2);
  while (row > 0 && u >= n[0] && u < n[1]) u = drawn(key, --row, 0, 2);
  int bad = u < (row ? n[0] : n[2]);
  return bad ^ (n[3] && (k - row) % 2 == 1);
}

static double traced(const double *table, double t, I count) {
  const double *delay = table + count;
  double at = fmod(t, delay[count]);
  I low = 0, high = count;
  while (low < high) {
    I middle = (low + high) / 2;
    if (at < table[middle])
      high = middle;
    else
      low = middle + 1;
  }
  return delay[low - 1];
}

/* Copies of one copy of message k; `key` as the rule's, of this copy. */
static int treat(Run *r, I stage, const U *key, I k, double sent, Copy copy, double distance,
                 Copy *new) {
  const double *n = r->number + stage * NUMBERS, *table = r->table + r->table_at[stage];
  double t = sent + copy.after, after = 0.0, begins, slots;
  new[0].after = new[1].after = 0.0;
  new[0].corrupt = new[1].corrupt = 0;
  switch (r->rule[stage]) {
    case LOSS:
      return !(drawn(key, k, 0, 2) < n[0]);
    case BURSTS:
      return !is_bad(n, key, k);
    case BY_DISTANCE:
      return distance - n[0] <= 0.0 || !(distance - n[0] >= n[1] * drawn(key, k, 0, 2));
    case DUPLICATE:
      return drawn(key, k, 0, 2) < n[0] ? 2 : 1;
    case CORRUPT:
      new[0].corrupt = drawn(key, k, 0, 2) < n[0];
      break;
    case CONSTANT:
      after = n[0];
      break;
    case UNIFORM:
      after = n[0] + drawn(key, k, 1, 2) * n[1];
      break;
    case JITTERED:
      after = jitter_of(n, key, table, k);
      break;
    case FLOOR:
      after = n[0] + n[1] * distance - copy.after;
      after = after > 0.0 ? after : 0.0;
      break;
    case REORDER:
      if ((k + 1) % (I)n[1] == 0 && drawn(key, k, 0, 2) < n[0])
        after = -copy.after;
      break;
    case RATE:
      begins = r->left[stage] > t ? r->left[stage] : t;
      if (begins - t > n[1]) return 0;
      after = begins + n[0] - t;
      break;
    case SLOT:
      slots = t / n[0];
      after = isfinite(slots) ? ceil(slots) * n[0] - t : 0.0;
      after = after > 0.0 ? after : 0.0;
      break;
    case TRACE:
      after = traced(table, t, (I)n[0]);
      if (after < 0.0) return 0;
      break;
  }
  new[0].after = after;
  return 1;
}

/* Copies of message k that arrive, with their delays; -1 if a rule failed. */
static int fate(Run *r, I link, I k, double sent, double distance, Copy *copies, U *faults) {
  int count = 1;
  copies[0].after = 0.0;
  copies[0].corrupt = 0;
  *faults = 0;
  for (I stage = r->stage_at[link]; stage < r->stage_at[link + 1]; ++stage) {
    Copy came[MOST_COPIES];
    int before = count;
    memcpy(came, copies, sizeof came);
    count = 0;
    for (int c = 0; c < before; ++c) {
      Copy new[2];
      if (c * 4 + 4 > KEYS) return -1;
      int made = treat(r, stage, r->key + stage * KEYS + 4 * c, k, sent, came[c], distance, new);
      double t = sent + came[c].after;
      if (made == 1 && new[0].after == 0.0 && !new[0].corrupt) {
        r->left[stage] = t;
        copies[count++] = came[c];
        continue;
      }
      *faults |= 1ULL << r->declared[stage];
      for (int n = 0; n < made; ++n) {
        double after = came[c].after + new[n].after;
        if (!(after >= 0.0) || !isfinite(after) || count == MOST_COPIES) return -1;
        r->left[stage] = t + new[n].after;
        copies[count].after = after;
        copies[count++].corrupt = came[c].corrupt || new[n].corrupt;
      }
    }
  }
  return count;
}
