/* Contacts and inboxes: plant's sampling/sensing.py and network/inbox.py explain them. */

/* Which broadcasts exist for agent i before t: from `first` to `last` of each sender that it sees.
 */
static void existing(const Run *r, I i, double t, const I *seen, I *first, I *last) {
  for (I j = 0; j < r->agents; ++j) {
    I newest = r->broadcast_t[2 * j + 1] < t ? r->broadcast_k[2 * j + 1] : r->broadcast_k[2 * j];
    I begun = r->contact[i * r->agents + j];
    first[j] = seen[j] && begun >= 0 && begun <= newest ? begun : -1;
    last[j] = newest;
  }
}

static void take_contacts(Run *r, I i, I k, double t, const I *seen, const I *hearers) {
  I n = r->agents, *heard = r->heard + i * n;
  for (I j = 0; j < n; ++j) {
    if (!seen[j]) r->contact[i * n + j] = -1;
    if (heard[j] && !hearers[j]) r->contact[j * n + i] = -1;
    if (hearers[j] && r->contact[j * n + i] < 0) r->contact[j * n + i] = k;
    heard[j] = hearers[j];
  }
  r->broadcast_t[2 * i] = r->broadcast_t[2 * i + 1];
  r->broadcast_k[2 * i] = r->broadcast_k[2 * i + 1];
  r->broadcast_t[2 * i + 1] = t + r->latency;
  r->broadcast_k[2 * i + 1] = k;
}

static void forget(Run *r, I i, I j) {
  I kept = 0;
  for (I f = 0; f < r->flights; ++f)
    if (r->flight[f].to != i || r->flight[f].from != j) r->flight[kept++] = r->flight[f];
  r->flights = kept;
  r->since[i * r->agents + j] = r->received[i * r->agents + j] = -1;
}

static int decide_fates(Run *r, I i, I j, I last, double distance) {
  I link = i * r->agents + j;
  if (last - r->decided[link] > RING || r->fates + RING > r->most_fates) return NO_ROOM;
  for (I k = r->decided[link] + 1; k <= last; ++k) {
    Copy copies[MOST_COPIES];
    U faults;
    I said = j * RING + k % RING;
    double sent = r->said_t[said], after = INFINITY;
    int count = fate(r, link, k, sent, distance, copies, &faults);
    if (count < 0) return RULE_FAILED;
    for (int c = 0; c < count; ++c) {
      if (copies[c].corrupt) {
        ++r->rejected[i];
        continue;
      }
      if (copies[c].after < after) after = copies[c].after;
      if (r->flights == r->most_flights) return NO_ROOM;
      Flight *f = &r->flight[r->flights++];
      *f = (Flight){i, j, k, sent + copies[c].after, sent, {0}};
      memcpy(f->u, r->said_u + said * MOST_INPUTS, sizeof f->u);
    }
    I f = r->fates++;
    r->fate_from[f] = j;
    r->fate_k[f] = k;
    r->fate_delay[f] = after == INFINITY ? -1.0 : 0.0 + after;
    r->fate_faults[f] = faults;
  }
  r->decided[link] = last;
  return GOES_ON;
}

static void deliver(Run *r, I i, double t) {
  I kept = 0;
  for (I j = 0; j < r->agents; ++j)
    for (I f = 0, link = i * r->agents + j; f < r->flights; ++f) {
      const Flight *copy = &r->flight[f];
      if (copy->to != i || copy->from != j || !(copy->at <= t)) continue;
      if (copy->k <= r->newest[link]) continue; /* a slow one, after one that was sent later */
      r->newest[link] = copy->k;
      r->received_t[link] = copy->t;
      memcpy(r->received_u + link * MOST_INPUTS, copy->u, sizeof copy->u);
      if (r->received[link] < 0) r->received[link] = r->ranks++;
    }
  for (I f = 0; f < r->flights; ++f)
    if (r->flight[f].to != i || !(r->flight[f].at <= t)) r->flight[kept++] = r->flight[f];
  r->flights = kept;
}

static double distance_between(const Run *r, I i, I j) {
  double square = 0.0;
  for (I c = 0; c < r->axes; ++c) {
    double off = r->p[i * r->axes + c] - r->p[j * r->axes + c];
    square += off * off;
  }
  return sqrt(square);
}

/* Decides all broadcasts that exist for agent i, and delivers those due by t. */
static int advance_inbox(Run *r, I i, double t, const I *first, const I *last) {
  I n = r->agents;
  for (I j = 0; j < n; ++j) {
    if (r->in_sight[i * n + j] && first[j] < 0) forget(r, i, j);
    r->in_sight[i * n + j] = first[j] >= 0;
  }
  for (I j = 0; j < n; ++j) {
    I link = i * n + j;
    if (first[j] < 0) continue;
    if (r->since[link] != first[j]) {
      forget(r, i, j);
      r->since[link] = first[j];
      r->decided[link] = first[j] - 1;
    }
    if (last[j] > r->decided[link]) {
      double distance = r->by_distance[link] ? distance_between(r, i, j) : NAN;
      int failed = decide_fates(r, i, j, last[j], distance);
      if (failed) return failed;
    }
  }
  deliver(r, i, t);
  return GOES_ON;
}
