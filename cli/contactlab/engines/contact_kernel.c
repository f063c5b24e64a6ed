/* Contacts of monitored pairs, read from mjData in each step of a rollout.
 *
 * MuJoCo calls `read_contacts` as its sensor callback: in each step, on the thread that steps, when
 * contacts and their forces are known and the state is still the one that they belong to. It looks
 * up the pair of each contact, so that a step costs what it has of contacts, not of pairs, and
 * leaves what contact sensors measure, bit for bit: the slots of a pair are its first contacts, as
 * they come, seen from the pair's first side.
 *
 * Compiled without fused multiplications, as these bits are those of sums of rounded products.
 */
#include <mujoco/mujoco.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* What is where in a slot; SLOT_WIDTH and its neighbours in contact/trace_arrays.py. */
enum { FOUND = 0, FORCE = 1, DISTANCE = 7, POSITION = 8, FRAME = 11, VELOCITY = 17, WIDTH = 23 };

/* What changes sign when a contact is seen from its other side: the normal and the tangent, and so
 * the third components of all that is given along both and their cross product. */
static const int flipped[] = {FORCE + 2, FORCE + 5, FRAME,     FRAME + 1,    FRAME + 2,
                              FRAME + 3, FRAME + 4, FRAME + 5, VELOCITY + 2, VELOCITY + 5};

typedef struct {
  mjtNum slot[WIDTH];
  int64_t row;     /* run * steps + step */
  int pair, place; /* whose slot it is, and which */
} Point;

typedef struct {
  int pairs;
  uint64_t* keys; /* (pairs) of their sides, ascending; see `key_of` */
  int* first;     /* (pairs) the first side: a geom or a body */
  int* most;      /* (pairs) how many slots each has */
  int* found;     /* (pairs) contacts in this step; 0 between steps */
  int steps;      /* of a run */
  int address;    /* in sensordata, of the count of all contacts, their least distance, and more */
  int width;      /* how many numbers from there on are recorded */
  Point* points;  /* of all runs */
  size_t count, capacity;
  int lacks_memory;
  size_t begin;  /* the first point of this run */
  int run, step; /* of what is recorded now */
  mjtNum* rows;  /* (steps, width) of this run */
  mjtNum* times; /* (steps) when its steps began */
} Recording;

static _Thread_local Recording* current; /* Another thread may step something else. */

/* Return what pairs are sorted and found by: whether sides are bodies, and both, in order. */
static uint64_t key_of(int bodies, int first, int second) {
  uint64_t low = first < second ? first : second, high = first < second ? second : first;
  return (uint64_t)bodies << 62 | low << 31 | high;
}

/* Return the first pair whose key is not below this one. */
static int find(const Recording* recording, uint64_t key) {
  int low = 0, high = recording->pairs;
  while (low < high) {
    int middle = low + (high - low) / 2;
    if (recording->keys[middle] < key) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return low;
}

/* Write the velocity of the body of a geom at a point, and its angular velocity after that. */
static void velocity_at(const mjModel* m, const mjData* d, int geom, const mjtNum* point,
                        mjtNum* velocity) {
  int body = m->geom_bodyid[geom];
  const mjtNum* spatial = d->cvel + 6 * body;
  const mjtNum* origin = d->subtree_com + 3 * m->body_rootid[body];
  mjtNum x = point[0] - origin[0], y = point[1] - origin[1], z = point[2] - origin[2];
  velocity[0] = spatial[3] - (y * spatial[2] - z * spatial[1]);
  velocity[1] = spatial[4] - (z * spatial[0] - x * spatial[2]);
  velocity[2] = spatial[5] - (x * spatial[1] - y * spatial[0]);
  memcpy(velocity + 3, spatial, 3 * sizeof(mjtNum));
}

/* Write what is measured of a contact, all but how many were found. */
static void measure(const mjModel* m, const mjData* d, int index, int flip, mjtNum* slot) {
  const mjContact* contact = d->contact + index;
  mjtNum before[6], after[6];
  mj_contactForce(m, d, index, slot + FORCE);
  slot[DISTANCE] = contact->dist;
  memcpy(slot + POSITION, contact->pos, 3 * sizeof(mjtNum));
  memcpy(slot + FRAME, contact->frame, 6 * sizeof(mjtNum));
  velocity_at(m, d, contact->geom[0], contact->pos, before);
  velocity_at(m, d, contact->geom[1], contact->pos, after);
  for (int each = 0; each < 6; each++) {
    after[each] -= before[each];
  }
  for (int each = 0; each < 6; each++) {
    const mjtNum* axis = contact->frame + 3 * (each % 3);
    const mjtNum* vector = after + (each < 3 ? 0 : 3);
    slot[VELOCITY + each] = axis[0] * vector[0] + axis[1] * vector[1] + axis[2] * vector[2];
  }
  for (size_t each = 0; flip && each < sizeof flipped / sizeof *flipped; each++) {
    slot[flipped[each]] *= -1.0;
  }
}

/* Return room for another point, or NULL if there is no memory for it. */
static Point* add_point(Recording* recording) {
  if (recording->count == recording->capacity) {
    size_t capacity = 2 * recording->capacity + 256;
    Point* points = realloc(recording->points, capacity * sizeof(Point));
    if (!points) {
      recording->lacks_memory = 1;
      return NULL;
    }
    recording->points = points;
    recording->capacity = capacity;
  }
  return recording->points + recording->count++;
}

/* Add a contact to the pairs of its sides, of which there may be none, or two of other orders. */
static void add_contact(Recording* recording, const mjModel* m, const mjData* d, int index,
                        int bodies, int first, int second) {
  uint64_t key = key_of(bodies, first, second);
  for (int pair = find(recording, key);
       pair < recording->pairs && recording->keys[pair] == key; pair++) {
    if (recording->found[pair]++ < recording->most[pair]) {
      Point* point = add_point(recording);
      if (!point) {
        return;
      }
      measure(m, d, index, first != recording->first[pair], point->slot);
      point->row = (int64_t)recording->run * recording->steps + recording->step;
      point->pair = pair;
      point->place = recording->found[pair] - 1;
    }
  }
}

/* Record a step once everything is computed: MuJoCo's sensor callback. */
static void read_contacts(const mjModel* m, mjData* d, int stage) {
  Recording* recording = current;
  if (!recording || stage != mjSTAGE_ACC) {
    return;
  }
  int step = recording->step;
  if (step >= recording->steps) {
    recording->step++;
    return;
  }
  size_t begin = recording->count;
  mjtNum least = d->ncon ? d->contact[0].dist : 0;
  for (int index = 0; index < d->ncon; index++) {
    const mjContact* contact = d->contact + index;
    int first = contact->geom[0], second = contact->geom[1];
    least = contact->dist < least ? contact->dist : least;
    if (first >= 0 && second >= 0) { /* A flex has no geom, and no body. */
      add_contact(recording, m, d, index, 0, first, second);
      add_contact(recording, m, d, index, 1, m->geom_bodyid[first], m->geom_bodyid[second]);
    }
  }
  for (size_t each = begin; each < recording->count; each++) {
    Point* point = recording->points + each;
    point->slot[FOUND] = recording->found[point->pair];
  }
  for (size_t each = begin; each < recording->count; each++) {
    recording->found[recording->points[each].pair] = 0;
  }
  mjtNum* row = recording->rows + (size_t)step * recording->width;
  memcpy(row, d->sensordata + recording->address, recording->width * sizeof(mjtNum));
  row[0] = d->ncon;
  row[1] = least;
  recording->times[step] = d->time;
  recording->step++;
}

void close_recording(Recording* recording) {
  if (recording) {
    free(recording->keys);
    free(recording->first);
    free(recording->most);
    free(recording->found);
    free(recording->points);
    free(recording);
  }
}

/* Return a recording of runs of some pairs; NULL if there is no memory for it.
 *
 * Of each pair, `sides` has whether it is of bodies, both sides, and its slots; `order` has the
 * pairs by ascending keys, so that pair k of all calls is order[k] of these. */
Recording* open_recording(int pairs, const int* sides, int steps, int address, int width) {
  Recording* recording = calloc(1, sizeof(Recording));
  if (!recording) {
    return NULL;
  }
  *recording = (Recording){.pairs = pairs, .steps = steps, .address = address, .width = width};
  recording->keys = calloc(pairs + 1, sizeof *recording->keys);
  recording->first = calloc(pairs + 1, sizeof *recording->first);
  recording->most = calloc(pairs + 1, sizeof *recording->most);
  recording->found = calloc(pairs + 1, sizeof *recording->found);
  if (!recording->keys || !recording->first || !recording->most || !recording->found) {
    close_recording(recording);
    return NULL;
  }
  for (int pair = 0; pair < pairs; pair++) {
    const int* each = sides + 4 * pair;
    recording->keys[pair] = key_of(each[0], each[1], each[2]);
    recording->first[pair] = each[1];
    recording->most[pair] = each[3];
  }
  return recording;
}

/* Record what this thread steps from now on as a run, into rows (steps, width) and times (steps).
 *
 * Return 0 where MuJoCo has the sensor callback of someone else. */
int begin_run(Recording* recording, int run, mjtNum* rows, mjtNum* times) {
  if (mjcb_sensor && mjcb_sensor != read_contacts) {
    return 0;
  }
  mjcb_sensor = read_contacts;
  recording->run = run;
  recording->step = 0;
  recording->begin = recording->count;
  recording->rows = rows;
  recording->times = times;
  current = recording;
  return 1;
}

/* End a run, and forget its points unless they are kept.
 *
 * Return how many steps it had, which may be more than were to be recorded; -1 without memory. */
int end_run(Recording* recording, int keep) {
  current = NULL;
  if (!keep) {
    recording->count = recording->begin;
  }
  return recording->lacks_memory ? -1 : recording->step;
}

/* Write how many slots of each pair (pairs) are filled at most. */
void find_widths(const Recording* recording, int* widths) {
  memset(widths, 0, recording->pairs * sizeof *widths);
  for (size_t each = 0; each < recording->count; each++) {
    const Point* point = recording->points + each;
    if (point->place >= widths[point->pair]) {
      widths[point->pair] = point->place + 1;
    }
  }
}

/* Copy all points into slots, zero before: (runs, steps, width, WIDTH) from a place for each pair. */
void fill_slots(const Recording* recording, const int* widths, const int64_t* places,
                mjtNum* slots) {
  for (size_t each = 0; each < recording->count; each++) {
    const Point* point = recording->points + each;
    int64_t slot = places[point->pair] + point->row * widths[point->pair] + point->place;
    memcpy(slots + slot * WIDTH, point->slot, WIDTH * sizeof(mjtNum));
  }
}
