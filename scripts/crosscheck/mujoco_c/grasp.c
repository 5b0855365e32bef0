// Executes the closing attempts of a dataset in MuJoCo, on one thread, with the decisions of crosscheck/attempt.py.
//
//   M=$(python -c 'import mujoco, os; print(os.path.dirname(mujoco.__file__))')
//   gcc -O3 -march=native -Wall -Wextra -I$M/include grasp.c -o grasp -L$M -l:libmujoco.so.4.0.0 -Wl,-rpath,$M -lm
//   PYTHONPATH=scripts python scripts/crosscheck/mujoco_c/export.py DATASET FOLDER [--rate HZ] [--primitives]
//
// Usage: grasp FOLDER [--scenes N] [--out FILE] [--early | --close | --ride] [--sleep] [NAME=VALUE ...]
// FOLDER is what export.py wrote. NAME is a field of mjOption (see `settings`), e.g. solver=1 noslip_iterations=0;
// disable=BITS and enable=BITS add to the flags.

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <mujoco/mujoco.h>

// Of the contract: see contract.py.
#define STOPPED_SPEED 0.002
#define STOPPED_TIME 0.025
#define GEAR_STIFFNESS 2000.0
#define GEAR_DAMPING 20.0
// Of the shortcuts: see shortcuts.rs.
#define NEAR 0.0005
#define STEADY_SPEED 0.001
#define STEADY_TURN 0.05
#define STEADY_TIME 0.025
#define WAY_CLEAR 0.001

enum { MAX_OBJECTS = 8, MAX_CORNERS = 64, MAX_NORMALS = 64, LEFT = 0, RIGHT = 1, PALM = 2, HAND = 3 };

// The contract's numbers, in the order of the first line of attempts.txt. SI.
static struct {
  double opening, force, speed, clearance, retreat, retreat_speed, close_time, hold_time;
  double empty_width, travel_share, push_max, lift_max, table_z;
} P;

typedef struct {
  double position[3], quat[4], axis[3], retreat[3];
  int id, target;
} Attempt;

// A convex shape: corners, normals of the faces (one of each opposite pair), a point inside.
typedef struct {
  int corner_count, normal_count;
  double centre[3], radius, corner[MAX_CORNERS][3], normal[MAX_NORMALS][3];
} Part;

// What is left out: the closing before anything is near, the lift once the target rides along.
typedef struct { bool close, ride; } Shortcuts;

static mjModel* m;
static mjData* d;
static double rate, distance;
static int object_count, body[MAX_OBJECTS], hand_qpos[HAND], hand_dof[HAND], palm_joint, root, hand_geom[HAND];
static int geom_of[MAX_OBJECTS];
static int* owner;  // Of a geom: object, or -1 - part of the hand, or -100 for the table.
static Part shape[MAX_OBJECTS + HAND];  // In the geoms' frames; the objects', then the hand's.
static long long simulated_steps, early_lifts, early_empty, skipped_steps, contacts, iterations;

static int steps_of(double time) { return (int)ceil(time * rate - 1e-3); }

static double smooth(double share) { return share >= 1 ? 1 : share * share * (3 - 2 * share); }

static double cpu_s(void) {
  struct timespec now;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static int id_of(int type, const char* name) {
  int id = mj_name2id(m, type, name);
  if (id < 0) { fprintf(stderr, "no %s\n", name); exit(1); }
  return id;
}

// ---- The hand: mujoco_engine.py ----

static double closed(int finger) { return d->qpos[hand_qpos[finger]]; }

static double width(void) { return fmax(P.opening - (closed(LEFT) + closed(RIGHT)), 0); }

static void actuate(double left, double right, double damping, double limit) {
  d->ctrl[LEFT] = left;
  d->ctrl[RIGHT] = right;
  for (int i = 0; i < 2; i++) {
    m->actuator_biasprm[i * mjNBIAS + 2] = -damping;
    m->actuator_forcerange[2 * i] = -limit;
    m->actuator_forcerange[2 * i + 1] = limit;
  }
}

static void begin(const Attempt* a) {
  // Before the reset, which decides who touches whom among those asleep.
  memcpy(m->body_pos + 3 * root, a->position, sizeof a->position);
  memcpy(m->body_quat + 4 * root, a->quat, sizeof a->quat);
  memcpy(m->jnt_axis + 3 * palm_joint, a->axis, sizeof a->axis);
  mj_resetData(m, d);
  distance = 0;
  actuate(P.force, P.force, P.force / P.speed, P.force);
  mj_kinematics(m, d);
}

static void step(void) {
  d->qvel[hand_dof[PALM]] = (distance - d->qpos[hand_qpos[PALM]]) * rate;
  mj_step(m, d);
  contacts += d->ncon;
  for (int i = 0; i < mjMAX(1, mjMIN(d->nisland, mjNISLAND)); i++) iterations += d->solver_niter[i];
  d->qpos[hand_qpos[PALM]] = distance;
  simulated_steps++;
}

static void press(double asymmetry) {
  double spring = GEAR_STIFFNESS * (closed(LEFT) - closed(RIGHT) - asymmetry) / 2;
  actuate(P.force - spring, P.force + spring, GEAR_DAMPING, 100 * P.force);
}

static void positions(double out[MAX_OBJECTS][3]) {
  mj_kinematics(m, d);
  for (int i = 0; i < object_count; i++) memcpy(out[i], d->xpos + 3 * body[i], sizeof out[i]);
}

// Whether both fingers press on the target; `only` says whether nothing but the hand does.
static bool grips(int target, bool* only) {
  bool by[2] = {false, false};
  *only = true;
  for (int c = 0; c < d->ncon; c++) {
    const mjContact* contact = d->contact + c;
    int first = owner[contact->geom[0]], second = owner[contact->geom[1]];
    if (first != target && second != target) continue;
    mjtNum force[6];
    mj_contactForce(m, d, c, force);
    if (!(force[0] > 0)) continue;
    int other = first == target ? second : first;
    if (other == -1 - LEFT || other == -1 - RIGHT) by[-1 - other] = true;
    else if (other != -1 - PALM) *only = false;
  }
  return by[LEFT] && by[RIGHT];
}

// ---- Shortcuts: tested_part.rs and shortcuts.rs ----

static void add_normal(Part* part, const double n[3]) {
  for (int i = 0; i < part->normal_count; i++) {
    double crossed[3];
    mju_cross(crossed, part->normal[i], n);
    if (mju_dot3(crossed, crossed) < 1e-8) return;
  }
  if (part->normal_count == MAX_NORMALS) { fprintf(stderr, "too many normals\n"); exit(1); }
  mju_copy3(part->normal[part->normal_count++], n);
}

static Part box_part(const double half[3]) {
  Part part = {.corner_count = 8, .normal_count = 3, .normal = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  for (int c = 0; c < 8; c++)
    for (int k = 0; k < 3; k++) part.corner[c][k] = (c >> k & 1) ? half[k] : -half[k];
  part.radius = mju_norm3(half);
  return part;
}

static Part part_of(int geom) {
  if (m->geom_type[geom] == mjGEOM_BOX) return box_part(m->geom_size + 3 * geom);
  int mesh = m->geom_dataid[geom];
  Part part = {.corner_count = m->mesh_vertnum[mesh]};
  if (part.corner_count > MAX_CORNERS) { fprintf(stderr, "too many corners\n"); exit(1); }
  for (int c = 0; c < part.corner_count; c++) {
    for (int k = 0; k < 3; k++) part.corner[c][k] = m->mesh_vert[3 * (m->mesh_vertadr[mesh] + c) + k];
    part.radius = fmax(part.radius, mju_norm3(part.corner[c]));
  }
  for (int n = 0; n < m->mesh_polynum[mesh]; n++) add_normal(&part, m->mesh_polynormal + 3 * (m->mesh_polyadr[mesh] + n));
  return part;
}

static void place(Part* out, const Part* part, int geom) {
  const mjtNum *turn = d->geom_xmat + 9 * geom, *at = d->geom_xpos + 3 * geom;
  out->corner_count = part->corner_count;
  out->normal_count = part->normal_count;
  out->radius = part->radius;
  mju_copy3(out->centre, at);
  for (int c = 0; c < part->corner_count; c++) {
    mju_mulMatVec3(out->corner[c], turn, part->corner[c]);
    mju_addTo3(out->corner[c], at);
  }
  for (int n = 0; n < part->normal_count; n++) mju_mulMatVec3(out->normal[n], turn, part->normal[n]);
}

static void span(const Part* part, const double axis[3], double* low, double* high) {
  *low = INFINITY, *high = -INFINITY;
  for (int c = 0; c < part->corner_count; c++) {
    double x = part->corner[c][0] * axis[0] + part->corner[c][1] * axis[1] + part->corner[c][2] * axis[2];
    *low = x < *low ? x : *low;
    *high = x > *high ? x : *high;
  }
}

// How far `a` can move along a direction before it meets `b`; infinite if it never does.
static double free_way(const Part* a, const Part* b, const double along[3]) {
  double entry = -INFINITY, leave = INFINITY, across[3], apart[3];
  mju_sub3(apart, b->centre, a->centre);
  mju_addScl3(across, apart, along, -mju_dot3(apart, along));
  mju_normalize3(across);
  for (int n = 0; n <= a->normal_count + b->normal_count; n++) {
    const double* axis = n < a->normal_count ? a->normal[n] : across;
    if (n >= a->normal_count && n < a->normal_count + b->normal_count) axis = b->normal[n - a->normal_count];
    double a_low, a_high, b_low, b_high, speed = mju_dot3(axis, along);
    span(a, axis, &a_low, &a_high);
    span(b, axis, &b_low, &b_high);
    double before = b_low - a_high, after = b_high - a_low;
    if (fabs(speed) < 1e-6) {
      if (before > 0 || after < 0) return INFINITY;
      continue;
    }
    entry = fmax(entry, fmin(before / speed, after / speed));
    leave = fmin(leave, fmax(before / speed, after / speed));
  }
  return entry > leave || leave < 0 ? INFINITY : fmax(entry, 0);
}

// A finger's height above the table when it has closed by so much.
static double finger_height(const Attempt* a, int finger, double closed_m) {
  double turn[9], centre[3];
  mju_quat2Mat(turn, a->quat);
  mju_copy3(centre, m->geom_pos + 3 * hand_geom[finger]);
  centre[1] += (finger == LEFT ? 1 : -1) * closed_m;
  const double *up = turn + 6, *half = m->geom_size + 3 * hand_geom[finger];
  double reach = fabs(up[0]) * half[0] + fabs(up[1]) * half[1] + fabs(up[2]) * half[2];
  return a->position[2] + mju_dot3(up, centre) - reach - P.table_z;
}

// Steps that the open fingers close before they come near anything; -1 if the jaws meet first.
static int free_closing(const Attempt* a) {
  double step_m = P.speed / rate, near = NEAR + 2 * step_m, free_m = INFINITY, turn[9];
  mju_quat2Mat(turn, a->quat);
  static Part finger, object;
  for (int f = LEFT; f <= RIGHT; f++) {
    double side = f == LEFT ? 1 : -1, half[3], inward[3] = {side * turn[1], side * turn[4], side * turn[7]};
    for (int k = 0; k < 3; k++) half[k] = m->geom_size[3 * hand_geom[f] + k] + near;
    Part grown = box_part(half);
    place(&finger, &grown, hand_geom[f]);
    for (int i = 0; i < object_count; i++) {
      place(&object, shape + i, geom_of[i]);
      free_m = fmin(free_m, free_way(&finger, &object, inward));
    }
    if (inward[2] < 0) free_m = fmin(free_m, fmax((finger_height(a, f, 0) - near) / -inward[2], 0));
  }
  double way = P.opening - P.empty_width, to_meet = ceil(way / 2 / step_m);
  if (free_m >= to_meet * step_m && to_meet <= steps_of(P.close_time)) return -1;
  return (int)(fmin(free_m, way / 2) / step_m);
}

static bool way_is_free(int target, const double along[3], double rest) {
  static Part mover[1 + HAND], other;
  mj_kinematics(m, d);
  place(mover, shape + target, geom_of[target]);
  for (int h = 0; h < HAND; h++) place(mover + 1 + h, shape + object_count + h, hand_geom[h]);
  for (int i = 0; i < object_count; i++) {
    if (i == target) continue;
    place(&other, shape + i, geom_of[i]);
    for (int k = 0; k < 1 + HAND; k++) {
      double apart[3];
      mju_sub3(apart, other.centre, mover[k].centre);
      mju_addToScl3(apart, along, -fmin(fmax(mju_dot3(apart, along), 0), rest));
      if (mju_norm3(apart) > mover[k].radius + other.radius) continue;
      if (free_way(mover + k, &other, along) <= rest + WAY_CLEAR) return false;
    }
  }
  return true;
}

static bool moves(int object, const double velocity[3]) {
  const mjtNum* v = d->qvel + m->body_dofadr[body[object]];
  double against[3];
  mju_sub3(against, v, velocity);
  return mju_norm3(against) > STEADY_SPEED || mju_norm3(v + 3) > STEADY_TURN;
}

// Whether the target is held for good; `LiftWatch::is_decided`.
static bool is_decided(int target, const double along[3], double speed, double rest, bool slowing, int* steady, bool* proven) {
  double velocity[3], still[3] = {0, 0, 0};
  bool only;
  mju_scl3(velocity, along, speed);
  *steady = !moves(target, velocity) && grips(target, &only) && only ? *steady + 1 : 0;
  if (*steady < steps_of(STEADY_TIME)) return false;
  *proven |= !slowing;
  if (!*proven) return false;
  for (int i = 0; i < object_count; i++)
    if (i != target && moves(i, still)) return false;
  *steady = 0;
  return way_is_free(target, along, rest);
}

// ---- The attempt: attempt.py ----

static double close_hand(int skipped) {
  int wanted = steps_of(STOPPED_TIME), stopped = 0;
  double slow = STOPPED_SPEED / rate, last[2] = {closed(LEFT), closed(RIGHT)};
  for (int i = skipped; i < steps_of(P.close_time); i++) {
    step();
    bool still = fabs(closed(LEFT) - last[0]) < slow && fabs(closed(RIGHT) - last[1]) < slow;
    stopped = still ? stopped + 1 : 0;
    last[0] = closed(LEFT), last[1] = closed(RIGHT);
    if (stopped >= wanted || width() <= P.empty_width) break;
  }
  return width();
}

static bool lift(const Attempt* a, const double start[3], Shortcuts s) {
  int moving = steps_of(P.retreat / P.retreat_speed), all = moving + steps_of(P.hold_time), steady = 0;
  double asymmetry = closed(LEFT) - closed(RIGHT), now[MAX_OBJECTS][3], gone[3];
  bool proven = false, only;
  for (int i = 1; i <= all; i++) {
    double last = distance, share = (double)i / moving;
    press(asymmetry);
    distance = P.retreat * smooth(share);
    step();
    if (width() <= P.empty_width) return false;
    bool slowing = share > 0.5 && share < 1;
    if (s.ride && is_decided(a->target, a->retreat, (distance - last) * rate, P.retreat - distance, slowing, &steady, &proven)) {
      early_lifts++;
      return true;
    }
  }
  positions(now);
  mju_sub3(gone, now[a->target], start);
  return mju_dot3(gone, a->retreat) >= P.travel_share * P.retreat && grips(a->target, &only);
}

static const char* attempt(const Attempt* a, Shortcuts s) {
  double before[MAX_OBJECTS][3], after[MAX_OBJECTS][3];
  begin(a);
  int skipped = s.close ? free_closing(a) : 0;
  if (skipped < 0) { early_empty++; return "empty"; }
  skipped_steps += skipped;
  for (int f = LEFT; f <= RIGHT; f++) {
    d->qpos[hand_qpos[f]] = skipped * P.speed / rate;
    d->qvel[hand_dof[f]] = P.speed;
  }
  positions(before);
  if (close_hand(skipped) <= P.empty_width) return "empty";
  positions(after);
  bool hit = false;
  for (int i = 0; i < object_count; i++) hit |= i != a->target && mju_dist3(after[i], before[i]) > P.push_max;
  for (int f = LEFT; f <= RIGHT; f++) hit |= finger_height(a, f, closed(f)) < P.clearance / 2;
  if (!lift(a, after[a->target], s)) return "slipped";
  positions(after);
  for (int i = 0; i < object_count; i++) hit |= i != a->target && after[i][2] - before[i][2] > P.lift_max;
  return hit ? "hit_other" : "held";
}

// ---- Scenes and options ----

#define REAL(name) {#name, offsetof(mjOption, name), true}
#define WHOLE(name) {#name, offsetof(mjOption, name), false}
static const struct { const char* name; size_t offset; bool is_real; } settings[] = {
    REAL(impratio), REAL(tolerance), REAL(ls_tolerance), REAL(noslip_tolerance), REAL(ccd_tolerance),
    REAL(sleep_tolerance), WHOLE(integrator), WHOLE(cone), WHOLE(jacobian), WHOLE(solver), WHOLE(iterations),
    WHOLE(ls_iterations), WHOLE(noslip_iterations), WHOLE(ccd_iterations)};

static void set(const char* text) {
  const char* value = strchr(text, '=');
  size_t length = value ? (size_t)(value - text) : 0;
  if (value && !strncmp(text, "disable=", 8)) { m->opt.disableflags |= (int)strtol(value + 1, NULL, 0); return; }
  if (value && !strncmp(text, "enable=", 7)) { m->opt.enableflags |= (int)strtol(value + 1, NULL, 0); return; }
  for (size_t i = 0; value && i < sizeof settings / sizeof *settings; i++) {
    if (strlen(settings[i].name) != length || strncmp(settings[i].name, text, length)) continue;
    char* field = (char*)&m->opt + settings[i].offset;
    if (settings[i].is_real) *(double*)field = atof(value + 1);
    else *(int*)field = atoi(value + 1);
    return;
  }
  fprintf(stderr, "unknown argument %s\n", text);
  exit(2);
}

static void load(const char* folder, int scene, char** changes, bool sleep) {
  static const char* parts[HAND] = {"left", "right", "palm"};
  char path[1000];
  snprintf(path, sizeof path, "%s/%d.mjb", folder, scene);
  if (!(m = mj_loadModel(path, NULL))) { fprintf(stderr, "no %s\n", path); exit(1); }
  for (; *changes; changes++) set(*changes);
  if (object_count > MAX_OBJECTS) { fprintf(stderr, "too many objects\n"); exit(1); }
  rate = round(1 / m->opt.timestep);
  root = id_of(mjOBJ_BODY, "root");
  palm_joint = id_of(mjOBJ_JOINT, "palm");
  owner = malloc((size_t)m->ngeom * sizeof *owner);
  owner[id_of(mjOBJ_GEOM, "table")] = -100;
  for (int i = 0; i < object_count; i++) {
    char name[20];
    snprintf(name, sizeof name, "object%d", i);
    body[i] = id_of(mjOBJ_BODY, name);
    geom_of[i] = id_of(mjOBJ_GEOM, name);
    owner[geom_of[i]] = i;
    shape[i] = part_of(geom_of[i]);
    // Objects stand still until they are touched.
    if (sleep) m->tree_sleep_policy[m->body_treeid[body[i]]] = mjSLEEP_INIT;
  }
  if (sleep) m->opt.enableflags |= mjENBL_SLEEP;
  for (int h = 0; h < HAND; h++) {
    int joint = id_of(mjOBJ_JOINT, parts[h]);
    hand_qpos[h] = m->jnt_qposadr[joint];
    hand_dof[h] = m->jnt_dofadr[joint];
    hand_geom[h] = id_of(mjOBJ_GEOM, parts[h]);
    owner[hand_geom[h]] = -1 - h;
    shape[object_count + h] = part_of(hand_geom[h]);
  }
  d = mj_makeData(m);
}

int main(int argc, char** argv) {
  Shortcuts s = {false, false};
  bool sleep = false;
  int scene, count, limit = 1 << 30, total, tried = 0, change_count = 0;
  char *changes[64] = {NULL}, stored[32], path[1000];
  FILE* out = NULL;
  double loading = 0, attempting = 0;
  for (int i = 2; i < argc; i++) {
    if (!strcmp(argv[i], "--early")) s.close = s.ride = true;
    else if (!strcmp(argv[i], "--close")) s.close = true;
    else if (!strcmp(argv[i], "--ride")) s.ride = true;
    else if (!strcmp(argv[i], "--sleep")) sleep = true;
    else if (!strcmp(argv[i], "--scenes") && i + 1 < argc) limit = atoi(argv[++i]);
    else if (!strcmp(argv[i], "--out") && i + 1 < argc) out = fopen(argv[++i], "w");
    else if (change_count < 63) changes[change_count++] = argv[i];
  }
  snprintf(path, sizeof path, "%s/attempts.txt", argc > 1 ? argv[1] : ".");
  FILE* in = fopen(path, "r");
  if (!in) { fprintf(stderr, "no %s\n", path); return 1; }
  double* numbers = (double*)&P;
  if (fscanf(in, "%d", &total) != 1) return 1;
  for (size_t i = 0; i < sizeof P / sizeof(double); i++)
    if (fscanf(in, "%lf", numbers + i) != 1) return 1;
  while (fscanf(in, " scene %d %d %d", &scene, &object_count, &count) == 3 && scene < limit) {
    double start = cpu_s();
    load(argv[1], scene, changes, sleep);
    loading += cpu_s() - start;
    for (int i = 0; i < count; i++) {
      Attempt a;
      double* values = (double*)&a;
      if (fscanf(in, "%d %d %31s", &a.id, &a.target, stored) != 3) return 1;
      for (int k = 0; k < 13; k++)
        if (fscanf(in, "%lf", values + k) != 1) return 1;
      start = cpu_s();
      const char* outcome = attempt(&a, s);
      attempting += cpu_s() - start;
      tried++;
      if (out) fprintf(out, "%d %d %s %s\n", scene, a.id, outcome, stored);
    }
    mj_deleteData(d);
    mj_deleteModel(m);
    free(owner);
  }
  printf("%d closing attempts, %lld steps (%.1f each), %.2f s CPU (+ %.2f s loading), %.2f us a step\n", tried,
         simulated_steps, (double)simulated_steps / tried, attempting, loading, 1e6 * attempting / (double)simulated_steps);
  printf("contacts a step %.2f, solver iterations %.2f; lifts ended early %lld, empty at once %lld, closing steps skipped %lld\n",
         (double)contacts / (double)simulated_steps, (double)iterations / (double)simulated_steps, early_lifts, early_empty,
         skipped_steps);
  printf("%.1f closing attempts/s", tried / attempting);
  if (limit == 1 << 30) printf(", %.1f attempts/s of all %d", total / attempting, total);
  printf("\n");
  return 0;
}
