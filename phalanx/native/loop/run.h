/* Tables, state and results of one run. Python fills and reads them by these names (memory.py), so
   each is declared once. Sizes are in brackets: N agents, d axes, n states and m inputs of all. */
#include <math.h>
#include <string.h>

typedef long long I;
typedef unsigned long long U;
typedef void (*Kernel)(const double *, double *, I);
typedef int (*Nearest)(int, double *, double, double);
typedef int (*Vertex)(int, int, const double *, double *);
typedef int (*Point)(int, int, double *, const double *, const double *, double, int,
                     const double *, int *);

enum {
  MOST_INPUTS = 8,
  MOST_AGENTS = 64,
  MOST_COPIES = 8,
  KEYS = 8,
  NUMBERS = 6,
  RING = 256,
  MOST_IN_SEGMENT = 4,
  FACE = MOST_INPUTS + 1
};
enum { GOES_ON = 0, OVER = 1, FULL = 2, NOT_FINITE = -1, RULE_FAILED = -2, NO_ROOM = -3 };

/* A copy of a broadcast that is under way. */
typedef struct {
  I to, from, k;
  double at, t, u[MOST_INPUTS];
} Flight;

/* Terms of h_tot of some members and obstacles: by_jets.py explains them. */
typedef struct {
  I degree, members, obstacles, parameters;
  I *agent;                    /* [members] of the run */
  I *state_at, *input_at;      /* [members + 1] first state among the numbers, first input */
  I *kind, *corner_at;         /* [members] and [members + 1] */
  double *corners;             /* of U of each member */
  double *low, *high, *metric; /* [m] */
  Kernel *extremes;            /* by kind of member: (c, corners) -> least and most of c u */
  I groups;
  Kernel *jets;                  /* [groups] */
  I *group_at, *width, *results; /* first pair of each group, numbers of a pair and of its jets */
  I *index_at, *indices;         /* [pairs] first of its indices; all of them */
  I *first, *second;             /* [pairs] member; other member, or members + obstacle */
  I *force_at, *force_input;     /* [pairs + 1] first of its forces; the input that each is of */
  I rooms, *room;                /* numbers of pairs, ascending, of each */
  Kernel *composition;
  Kernel *near;             /* [members] (state, parameters) -> 1 for each obstacle in sight */
  double *numbers;          /* states, then obstacles' parameters */
  double *rows, *values;    /* arguments, and results of jets */
  double *columns, *chain;  /* jets of pairs in sight; ψ_0 ... ψ_{q-1}, unforced part, weights */
  double *around;           /* [obstacles] 1 for those in sight */
  double *c, *least, *most; /* [m], and [members] extremes of c u */
  I *shown, *value_at;      /* [pairs] those in sight, and their first values */
} Terms;

typedef struct {
  I agents, axes;
  double latency, step, duration;
  I *state_at, *input_at, *adversary;
  double *period, *jitter;
  U *clock_key;
  I *hears;      /* [N][N] of receiver and sender */
  double *reach; /* [N] square of the sensing radius [m²] */
  I limited;

  /* Links, as receiver and sender, and their rules. */
  I *stage_at, *by_distance; /* [N N + 1], and [N N] whether a rule asks for the distance */
  I *rule, *declared;
  double *number; /* [rules][NUMBERS] */
  U *key;         /* [rules][KEYS] */
  I *table_at;
  double *table, *left; /* [rules] time at which the last message left it [s] */

  /* Motion: agents by equation of motion, 1 to 4 steps of each; disturbances. */
  I kinds, *kind_at, *kind_agent;
  Kernel *motion;
  U *knot_key;
  double *half_width, *every;

  /* Goals: pieces of polynomials of (t - begin) / scale, or places to reach. */
  I *goal, *piece_at;
  double *piece_begin, *piece_scale;
  I *term_at;
  double *term, *tolerance; /* [terms][3 d] the highest power first */
  I *reached;

  /* Laws. */
  I *law, *goal_numbers; /* so many of the goal's are arguments */
  Kernel *wish;          /* [N][N + 1] by target, then that of none */
  I *target, *script_at;
  double *script_begin, *script;
  Terms *team; /* [N] of a guard; degree 0: none */
  I *team_member;
  double *team_margin;

  /* Rows. */
  double *margin;
  I information;
  double silence, *unchanged, *faces; /* [N][16][FACE] rows of U, with bounds */
  I *face_count;
  Terms *terms;
  Nearest nearest;

  /* Rows of pairs, [N + 1] of each agent: the other, functions of a half and a whole row, -1: none;
     the first index of its numbers. */
  I pairwise, *row_at, *row_other, *row_half, *row_whole, *row_index_at, *row_index, *shares;
  I *row_kind;          /* that of now, -1 if it is out of sight */
  Kernel *row_function; /* by kind of row */
  I *kind_width, *kind_half;
  double *row_a, *row_bound, *row_margin, *residual, *program;
  I *row_of;
  Point nearest_point;
  Vertex least_vertex;
  double *limits;
  int *row_numbers;

  /* State. */
  double t, *x, *p, *u; /* [n], [N][d], [m] */
  double line_begin, line_end, *phi, *slope;
  I *k;
  double *next_sample, *due, *pending; /* due: infinite if no input is; pending [N][MOST_INPUTS] */
  I *newest_step;
  I *contact, *heard;  /* [N][N] first broadcast or -1; receivers of the newest */
  double *broadcast_t; /* [N][2] of the last two */
  I *broadcast_k;
  double *said_t, *said_u; /* [N][RING] broadcasts by number */
  I *since, *decided, *newest, *in_sight;
  I *received, ranks; /* [N][N] rank by which it came, or -1 */
  double *received_t, *received_u;
  I flights;
  Flight *flight;
  I *rejected;
  double *scratch;

  /* Results since the last call. */
  I instants;
  double *instant_t;
  I *instant_steps, *instant_applied, *instant_segments; /* ends */
  I segments;
  double *segment_t, *segment_dt;
  I *segment_steps, *segment_knot;
  double *segment_phi, *segment_slope, *segment_u, *segment_start;
  double *segment_x, *segment_p; /* [segments][4][n] and [N][d] */
  I first_step, steps, *step_i, *step_k;
  double *step_t;
  I *step_origin, *step_rejected;
  double *step_residual, *step_margin, *step_wish, *step_u;
  I *step_ages, *step_fates, *step_bindings; /* ends */
  I bindings, *binding_of;
  I ages, *age_of;
  double *age;
  I fates, *fate_from, *fate_k;
  double *fate_delay;
  U *fate_faults;
  I applied, *applied_step;
  I most_instants, most_segments, most_steps, most_ages, most_fates, most_flights, most_bindings;
} Run;
