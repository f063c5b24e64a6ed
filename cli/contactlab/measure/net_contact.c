/* The contacts of one pair, reduced over its slots in one pass over each run.
 *
 * It leaves the bits of `_reduced` in net_contact.py: sums go slot by slot, or as NumPy goes where
 * it sums what lies together. Runs with what is not finite, and with negative zeros where a larger
 * one of two is sought, are left to NumPy, so that nothing here depends on what it makes of them.
 */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

/* What is where in a slot; SLOT_WIDTH and its neighbours in contact/trace_arrays.py. */
enum { NORMAL = 1, ALONG = 2, ACROSS = 3, DISTANCE = 7, FRAME = 11, SLIP = 18, TURNING = 20 };

/* Series over time, and the worst of a run, in the order of `_reduced`. */
enum { FORCE, TANGENTIAL, USAGE, SPEED, LEAST, HARDEST, GRIP, ROLLING, SPINNING, SERIES };
enum { EXCESS, DETACHED, FARTHEST, STANDOFF };

enum { AHEAD = 8 }; /* steps by which slots are fetched before they are reduced */

static const double forceless = 1e-9; /* As _FORCELESS. */

typedef struct {
  const double* slots;                        /* (n, N, S, 23), each slot in one piece */
  int64_t by_run, by_step, by_slot;           /* strides, in numbers */
  int64_t runs, steps;
  const int32_t* contacts;                    /* (n, N) filled slots, which come first */
  const double *friction, *stretch;           /* (n,) of the cone, as is the next */
  const uint8_t* elliptic;
  double *series, *worst;                     /* (SERIES, n, N), zero, and (4, n) */
  double* room;                               /* for (3, S, N) and (6, S) numbers */
  uint8_t* left;                              /* (n,) whether a run is left to NumPy */
} Pair;

typedef struct {
  double friction, stretch;
  int elliptic;
} Cone;

typedef struct {
  double tangential, used, impulse; /* of the net force, in the cone's norm; and of velocities */
} Sums;

static double larger(double one, double other) { return one > other ? one : other; }

static double ratio(double part, double whole) { return part / (whole > 0 ? whole : INFINITY); }

/* Return what the cone bounds of a force; the 2-norm adds a square off the plane. */
static double norm(const Cone* cone, double along, double across, double out_of_plane) {
  across *= cone->stretch;
  if (!cone->elliptic) {
    return fabs(along) + fabs(across);
  }
  return sqrt(along * along + across * across + out_of_plane);
}

/* Return whether a number is a negative zero, or not finite. */
static int is_awkward(double number) {
  return !(number - number == 0) || (number == 0 && signbit(number));
}

/* Return the sum of numbers that lie together, in the order in which NumPy adds them. */
static double sum(const double* numbers, int64_t count) {
  if (count > 128) {
    int64_t half = count / 2 - count / 2 % 8;
    return sum(numbers, half) + sum(numbers + half, count - half);
  }
  double total = 0;
  int64_t next = 0;
  if (count >= 8) {
    double part[8];
    memcpy(part, numbers, sizeof part);
    for (next = 8; next + 8 <= count; next += 8) {
      for (int each = 0; each < 8; each++) {
        part[each] += numbers[next + each];
      }
    }
    total = ((part[0] + part[1]) + (part[2] + part[3])) +
            ((part[4] + part[5]) + (part[6] + part[7]));
  }
  for (; next < count; next++) {
    total += numbers[next];
  }
  return total;
}

static double dot(const double* one, const double* other) {
  return one[0] * other[0] + one[1] * other[1] + one[2] * other[2];
}

/* Write normal x tangent of a frame, which has both. */
static void cross(const double* frame, double* cotangent) {
  const double x = frame[0], y = frame[1], z = frame[2], p = frame[3], q = frame[4], r = frame[5];
  cotangent[0] = y * r - z * q;
  cotangent[1] = z * p - x * r;
  cotangent[2] = x * q - y * p;
}

static int frames_differ(const double* slot, int64_t by_slot, int64_t width) {
  for (int64_t place = 1; place < width; place++) {
    const double* frame = slot + place * by_slot + FRAME;
    for (int each = 0; each < 6; each++) {
      if (frame[each] != slot[FRAME + each]) {
        return 1;
      }
    }
  }
  return 0;
}

/* Return sums over all slots of a step, in the world frame; there is room for (6, width). */
static Sums sum_in_world(const double* slot, int64_t by_slot, int64_t width, const Cone* cone,
                         double* room) {
  double cotangent[3], total[6];
  for (int64_t place = 0; place < width; place++) {
    const double *now = slot + place * by_slot, *tangent = now + FRAME + 3;
    const double along = now[SLIP] * now[NORMAL], across = now[SLIP + 1] * now[NORMAL];
    cross(now + FRAME, cotangent);
    for (int each = 0; each < 3; each++) {
      room[each * width + place] = now[ALONG] * tangent[each] + now[ACROSS] * cotangent[each];
      room[(3 + each) * width + place] = along * tangent[each] + across * cotangent[each];
    }
  }
  for (int each = 0; each < 6; each++) {
    total[each] = sum(room + each * width, width);
  }
  cross(slot + FRAME, cotangent);
  const double square = dot(total, total), along = dot(total, slot + FRAME + 3),
               across = dot(total, cotangent);
  const double used = norm(cone, along, across, square - along * along - across * across);
  return (Sums){sqrt(square), used, sqrt(dot(total + 3, total + 3))};
}

/* Return the most that one contact's tangential force exceeds its bound, as a share. */
static double excess(const double* normal, const double* used, int64_t count, const Cone* cone) {
  double hardest = 0, most = 1;
  for (int64_t each = 0; each < count; each++) {
    hardest = larger(hardest, normal[each]);
  }
  for (int64_t each = 0; each < count; each++) {
    const double bound = cone->friction * normal[each];
    if (used[each] > bound && normal[each] > forceless * hardest) {
      most = larger(most, used[each] / bound);
    }
  }
  return most - 1;
}

/* What is kept of each slot of a run, (S, N) each: the normal force, what the cone bounds, and the
 * normal force times a positive distance. */
typedef struct {
  int64_t steps, width;
  double *normal, *used, *apart, *room;
  double farthest, detached;
} Columns;

/* Reduce a step in which so many slots are filled; return whether numbers are awkward. */
static int reduce_step(const double* slot, int64_t by_slot, int64_t count, int64_t step,
                       const Cone* cone, Columns* columns, double* now) {
  double normal = 0, each = 0, force[2] = {0, 0}, slip[2] = {0, 0};
  double least = INFINITY, hardest = count < columns->width ? 0 : -INFINITY;
  int awkward = 0;
  for (int64_t place = 0; place < count; place++, slot += by_slot) {
    const int64_t entry = place * columns->steps + step;
    const double used = norm(cone, slot[ALONG], slot[ACROSS], 0);
    const double apart = slot[NORMAL] * larger(slot[DISTANCE], 0);
    awkward |= is_awkward(slot[NORMAL]) | is_awkward(slot[DISTANCE]) | is_awkward(apart);
    normal += slot[NORMAL];
    each += used;
    for (int axis = 0; axis < 2; axis++) {
      force[axis] += slot[ALONG + axis];
      slip[axis] += slot[SLIP + axis] * slot[NORMAL];
    }
    least = slot[DISTANCE] < least ? slot[DISTANCE] : least;
    hardest = larger(hardest, slot[NORMAL]);
    columns->farthest = larger(columns->farthest, slot[DISTANCE]);
    columns->detached = larger(columns->detached, apart);
    columns->normal[entry] = slot[NORMAL];
    columns->used[entry] = used;
    columns->apart[entry] = apart;
  }
  slot -= count * by_slot;
  Sums sums = {sqrt(force[0] * force[0] + force[1] * force[1]), norm(cone, force[0], force[1], 0),
               sqrt(slip[0] * slip[0] + slip[1] * slip[1])};
  if (frames_differ(slot, by_slot, columns->width)) {
    sums = sum_in_world(slot, by_slot, columns->width, cone, columns->room);
  }
  const double bound = cone->friction * normal, *turning = slot + TURNING;
  now[FORCE] = normal;
  now[TANGENTIAL] = sums.tangential;
  now[USAGE] = ratio(sums.used, bound);
  now[SPEED] = ratio(sums.impulse, normal);
  now[LEAST] = least;
  now[HARDEST] = hardest;
  now[GRIP] = ratio(each, bound);
  now[ROLLING] = sqrt(turning[1] * turning[1] + turning[2] * turning[2]);
  now[SPINNING] = fabs(turning[0]);
  double total = 0;
  for (int kind = 0; kind < SERIES; kind++) {
    total += now[kind];
  }
  return awkward | !(total - total == 0);
}

/* Reduce a run; return whether numbers are awkward. */
static int reduce_run(const Pair* pair, int64_t run) {
  const Cone cone = {pair->friction[run], pair->stretch[run], pair->elliptic[run]};
  const int64_t steps = pair->steps;
  const int32_t* contacts = pair->contacts + run * steps;
  int64_t width = 1;
  for (int64_t step = 0; step < steps; step++) {
    width = contacts[step] > width ? contacts[step] : width;
  }
  const int64_t count = width * steps;
  Columns columns = {steps, width, pair->room, pair->room + count, pair->room + 2 * count,
                     pair->room + 3 * count, 0, 0};
  memset(pair->room, 0, 3 * count * sizeof(double));
  const double* slot = pair->slots + run * pair->by_run;
  for (int64_t step = 0; step < steps; step++, slot += pair->by_step) {
    if (step + AHEAD < steps && contacts[step + AHEAD]) {
      for (int64_t each = 0; each < width * 23; each += 8) {
        __builtin_prefetch(slot + AHEAD * pair->by_step + each);
      }
    }
    if (!contacts[step]) {
      continue;
    }
    double now[SERIES];
    if (reduce_step(slot, pair->by_slot, contacts[step], step, &cone, &columns, now)) {
      return 1;
    }
    for (int kind = 0; kind < SERIES; kind++) {
      pair->series[(kind * pair->runs + run) * steps + step] = now[kind];
    }
  }
  double weight = larger(sum(columns.normal, count), DBL_MIN), *worst = pair->worst + run;
  worst[EXCESS * pair->runs] = excess(columns.normal, columns.used, count, &cone);
  worst[DETACHED * pair->runs] = columns.detached;
  worst[FARTHEST * pair->runs] = columns.farthest;
  worst[STANDOFF * pair->runs] = sum(columns.apart, count) / weight;
  return 0;
}

/* Reduce the runs of a pair; write whether each is left to NumPy.
 *
 * The slots of a single step lie together, so that NumPy adds them in another order. */
void reduce_pair(const Pair* pair) {
  for (int64_t run = 0; run < pair->runs; run++) {
    pair->left[run] = pair->steps < 2 || reduce_run(pair, run);
  }
}
