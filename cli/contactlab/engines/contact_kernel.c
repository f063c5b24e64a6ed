/* Runs of MuJoCo whose contacts are read from mjData after each step.
 *
 * `record_run` makes the steps of one run within MuJoCo's batch, which loads the state and catches
 * errors. As the batch's own rollout does, it sets the inputs, steps, records, and stops where
 * MuJoCo warns. In place of contact sensors, which compare each pair with each contact, it looks up
 * the pair of each contact, so that a step costs what it has of contacts, not of pairs.
 *
 * It leaves the bits that sensors leave: the slots of a pair are its first contacts, as they come,
 * seen from the pair's first side. So it is compiled without fused multiplications.
 */
#include <mujoco/mjbatch.h>
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
  uint64_t key;    /* of both sides; see `key_of` */
  int first, most; /* the first side, a geom or a body; how many slots there are */
  int number;      /* which of the pairs as they are declared */
  int width;       /* how many slots any step fills */
  int found;       /* contacts in this step; 0 between steps */
  int before;      /* the pair that was found before it in this step, or -1 */
  mjtNum* slots;   /* (run * steps + step, width, WIDTH), with room for so many slots */
  size_t room;
  size_t next;     /* the slot that is written next; all before it are, zero where empty */
} Pair;

typedef struct {
  mjtNum* slots;
  size_t room;
} Memory;

typedef struct { /* A field of mjData that is copied after each step. */
  char* target;
  const char* source;
  int64_t size; /* bytes of a step */
} Field;

/* Where a loop that somebody else steps is recorded. */
typedef struct {
  mjtNum *states, *rows, *kept; /* (room + 1, nstate), (room, width), and room for a state */
  int64_t room, fields;         /* for so many steps, and what else is kept */
  const Field* field;
} Loop;

typedef struct {
  mjBatch* batch;
  const mjModel* model; /* of this run */
  int pairs, steps;
  Pair* pair;         /* (pairs) by ascending keys */
  int sensor;         /* that of the first pair; the others', and that of all contacts, follow */
  int address, width; /* in sensordata: of the latter, and how many numbers there are from there */
  size_t rows;        /* steps of all runs, where they are known */
  int last;           /* the pair that was found last in this step, or -1 */
  int lacks_memory;
  int run, step; /* of what is recorded now */
  Loop loop;
  int begun, free, subject, holder; /* of a loop: whether it has a start; see `read_acting` */
} Recording;

/* What one run takes and leaves, as the caller has it. */
typedef struct {
  const mjModel* model;
  const mjtNum *qpos, *qvel, *ctrl, *applied, *act; /* the start */
  const mjtNum* control;                            /* (steps, inputs) */
  mjtNum *state, *rows;    /* (steps, 1 + nq + nv + na) and (steps, width) */
  int* iterations;         /* (steps, mjNISLAND) */
  mjtNum* forces[9];       /* what is recorded of the fields in `force`, or NULL */
  int *warnings;           /* (mjNWARNING) how often each was raised */
  int64_t run, spec, inputs; /* its number; which inputs change, and how many numbers they are */
} Run;

/* What recordings had that ended, by pair as declared: fresh pages would cost as much as copies. */
static _Thread_local struct { Memory* memory; int pairs; } spare;

/* Return what pairs are sorted and found by: whether sides are bodies, and both, in order. */
static uint64_t key_of(int bodies, int first, int second) {
  uint64_t low = first < second ? first : second, high = first < second ? second : first;
  return (uint64_t)bodies << 62 | low << 31 | high;
}

static int by_key(const void* one, const void* other) {
  const Pair *a = one, *b = other;
  return a->key != b->key ? (a->key > b->key) - (a->key < b->key) : a->number - b->number;
}

/* Return the first pair whose key is not below this one. */
static int find(const Recording* recording, uint64_t key) {
  int low = 0, high = recording->pairs;
  while (low < high) {
    int middle = low + (high - low) / 2;
    if (recording->pair[middle].key < key) {
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

/* Where the memory of slots comes from, which other libraries may provide. */
static void* (*resize_slots)(void*, size_t) = realloc;
static void (*release_slots)(void*) = free;

void set_memory(void* (*resize)(void*, size_t), void (*release)(void*)) {
  resize_slots = resize;
  release_slots = release;
}

/* Make room for so many slots of a pair; return whether there is memory for them. */
static int make_room(Recording* recording, Pair* pair, size_t count) {
  if (count <= pair->room) {
    return 1;
  }
  size_t all = recording->rows * pair->width, room = count <= all ? all : 2 * count + 64;
  mjtNum* slots = resize_slots(pair->slots, room * WIDTH * sizeof(mjtNum));
  if (!slots) {
    recording->lacks_memory = 1;
    return 0;
  }
  pair->slots = slots;
  pair->room = room;
  return 1;
}

static void clear(Pair* pair, size_t stop) {
  if (pair->next < stop) {
    memset(pair->slots + pair->next * WIDTH, 0, (stop - pair->next) * WIDTH * sizeof(mjtNum));
    pair->next = stop;
  }
}

/* Give each step of a pair another slot, since the last one has filled all of its own. */
static int widen(Recording* recording, Pair* pair) {
  const size_t rows = pair->width ? pair->next / pair->width : 0, width = pair->width++;
  if (!make_room(recording, pair, rows * pair->width)) {
    pair->width--;
    return 0;
  }
  for (size_t row = rows; row-- > 0;) {
    mjtNum* target = pair->slots + row * pair->width * WIDTH;
    memmove(target, pair->slots + row * width * WIDTH, width * WIDTH * sizeof(mjtNum));
    memset(target + width * WIDTH, 0, WIDTH * sizeof(mjtNum));
  }
  pair->next = rows ? rows * pair->width - 1 : 0;
  return 1;
}

/* Return the slot of a contact that was just found, or NULL if there is no memory for it. */
static mjtNum* add_slot(Recording* recording, Pair* pair) {
  if (pair->found > pair->width && !widen(recording, pair)) {
    return NULL;
  }
  const size_t row = (size_t)recording->run * recording->steps + recording->step,
               place = row * pair->width + pair->found - 1;
  if (!make_room(recording, pair, place + 1)) {
    return NULL;
  }
  clear(pair, place);
  pair->next = place + 1;
  return pair->slots + place * WIDTH;
}

/* Add a contact to the pairs of its sides, of which there may be two of opposite orders. */
static void add_contact(Recording* recording, const mjModel* m, const mjData* d, int index,
                        int bodies, int first, int second) {
  uint64_t key = key_of(bodies, first, second);
  for (int place = find(recording, key);
       place < recording->pairs && recording->pair[place].key == key; place++) {
    Pair* pair = recording->pair + place;
    if (!pair->found++) {
      pair->before = recording->last;
      recording->last = place;
    }
    if (pair->found <= pair->most) {
      mjtNum* slot = add_slot(recording, pair);
      if (!slot) {
        return;
      }
      measure(m, d, index, first != pair->first, slot);
    }
  }
}

/* Read all contacts of a step; write how many there are and their least distance. */
static void read_contacts(Recording* recording, const mjModel* m, const mjData* d, mjtNum* all) {
  int bodies = recording->pairs && recording->pair[recording->pairs - 1].key >> 62;
  all[0] = d->ncon;
  all[1] = d->ncon ? d->contact[0].dist : 0;
  for (int index = 0; index < d->ncon; index++) {
    const mjContact* contact = d->contact + index;
    int first = contact->geom[0], second = contact->geom[1];
    all[1] = contact->dist < all[1] ? contact->dist : all[1];
    if (first >= 0 && second >= 0) { /* A flex has no geom, and no body. */
      add_contact(recording, m, d, index, 0, first, second);
      if (bodies) {
        add_contact(recording, m, d, index, 1, m->geom_bodyid[first], m->geom_bodyid[second]);
      }
    }
  }
  for (; recording->last >= 0; recording->last = recording->pair[recording->last].before) {
    Pair* pair = recording->pair + recording->last;
    const int filled = pair->found < pair->width ? pair->found : pair->width;
    for (int place = 1; place <= filled && !recording->lacks_memory; place++) {
      pair->slots[(pair->next - place) * WIDTH + FOUND] = pair->found;
    }
    pair->found = 0;
  }
}

/* Write where forces are that may be recorded, in the order of `FORCES` in step_work.py. */
static void find_forces(const mjModel* m, const mjData* d, const mjtNum** forces, int* widths) {
  const mjtNum* found[] = {d->qfrc_constraint, d->qfrc_actuator, d->actuator_velocity,
                           d->actuator_force,  d->qfrc_smooth,   d->qfrc_bias,
                           d->qfrc_spring,     d->qfrc_damper,   d->qfrc_fluid};
  memcpy(forces, found, sizeof found);
  for (int each = 0; each < 9; each++) {
    widths[each] = each == 2 || each == 3 ? m->nu : m->nv;
  }
}

/* Make a step, and read its contacts, as `read_contacts` does. */
static void make_step(Recording* recording, const mjModel* m, mjData* d, mjtNum* all) {
  if (m->opt.integrator != mjINT_RK4) {
    mj_step(m, d);
    read_contacts(recording, m, d, all);
    return;
  }
  /* As mj_step does, which would leave the contacts of the last stage. */
  mj_checkPos(m, d);
  mj_checkVel(m, d);
  mj_forward(m, d);
  mj_checkAcc(m, d);
  if (m->opt.enableflags & mjENBL_FWDINV) {
    mj_compareFwdInv(m, d);
  }
  read_contacts(recording, m, d, all);
  mj_RungeKutta(m, d, 4);
}

static void* copy(void* target, const void* source, size_t count, size_t size) {
  if (count) {
    memcpy(target, source, count * size);
  }
  return (char*)target + count * size;
}

typedef struct {
  Recording* recording;
  const Run* run;
} Task;

/* Make the steps of a run on data that holds its start: a function that a batch applies. */
static void make_steps(const mjModel* m, mjData* d, int sim, void* argument) {
  (void)sim;
  const Task* task = argument;
  Recording* recording = task->recording;
  const Run* run = task->run;
  const size_t number = sizeof(mjtNum), nstate = 1 + m->nq + m->nv + m->na;
  const mjtNum* forces[9];
  int widths[9], before[mjNWARNING], warned = 0;
  find_forces(m, d, forces, widths);
  for (int kind = 0; kind < mjNWARNING; kind++) {
    before[kind] = d->warning[kind].number;
  }
  for (int step = 0; step < recording->steps; step++) {
    mjtNum* state = run->state + step * nstate;
    mjtNum* row = run->rows + (size_t)step * recording->width;
    int* iterations = run->iterations + (size_t)step * mjNISLAND;
    if (warned) { /* What is not valid must be numbers: the last ones. */
      copy(state, state - nstate, nstate, number);
      copy(row, row - recording->width, recording->width, number);
      copy(iterations, iterations - mjNISLAND, mjNISLAND, sizeof *iterations);
    } else {
      if (run->inputs) {
        mj_setState(m, d, run->control + (size_t)step * run->inputs, run->spec);
      }
      mjtNum all[2];
      recording->step = step;
      make_step(recording, m, d, all);
      *state++ = d->time;
      state = copy(state, d->qpos, m->nq, number);
      state = copy(state, d->qvel, m->nv, number);
      copy(state, d->act, m->na, number);
      copy(row, d->sensordata + recording->address, recording->width, number);
      copy(row, all, 2, number);
      copy(iterations, d->solver_niter, mjNISLAND, sizeof *iterations);
    }
    for (int each = 0; each < 9; each++) {
      if (run->forces[each]) {
        copy(run->forces[each] + (size_t)step * widths[each], forces[each], widths[each], number);
      }
    }
    for (int kind = 0; kind < mjNWARNING && !warned; kind++) {
      warned = d->warning[kind].number != before[kind];
    }
  }
  for (int kind = 0; kind < mjNWARNING; kind++) {
    run->warnings[kind] = d->warning[kind].number - before[kind];
  }
}

static void start(mjBatch* batch, int component, const mjtNum* values) {
  int size = 0;
  mjtNum* target = mjb_stateComponent(batch, component, &size);
  copy(target, values, size, sizeof(mjtNum));
}

/* Leave the slots of the run empty that is recorded now. */
static void forget_run(Recording* recording) {
  recording->last = -1;
  for (Pair* pair = recording->pair; pair < recording->pair + recording->pairs; pair++) {
    const size_t begin = (size_t)recording->run * recording->steps * pair->width;
    pair->next = pair->next < begin ? pair->next : begin;
    pair->found = 0;
  }
}

/* Make a run, and record it; return 0, or what went wrong.
 *
 * Nothing of a run stays that MuJoCo raised an error in. Meanwhile its contact sensors are off. */
const char* record_run(Recording* recording, const Run* run) {
  Task task = {recording, run};
  const int ids[] = {0};
  int* stage = run->model->sensor_needstage + recording->sensor;
  int own[2] = {stage[0], stage[recording->pairs]};
  recording->model = run->model;
  mjb_setModels(recording->batch, &recording->model);
  mjb_reset(recording->batch, ids, 1, NULL, mjSTAGE_NONE);
  start(recording->batch, mjSTATE_QPOS, run->qpos);
  start(recording->batch, mjSTATE_QVEL, run->qvel);
  start(recording->batch, mjSTATE_CTRL, run->ctrl);
  start(recording->batch, mjSTATE_XFRC_APPLIED, run->applied);
  start(recording->batch, mjSTATE_ACT, run->act);
  for (int each = 0; each <= recording->pairs; each++) {
    stage[each] = mjSTAGE_NONE;
  }
  recording->run = run->run;
  /* MuJoCo's Python package has it read a clock for its profile dozens of times in each step. */
  mjfTime clock = mjcb_time;
  mjcb_time = NULL;
  int failed = mjb_apply(recording->batch, ids, 1, make_steps, &task, 0);
  if (clock) {
    mjcb_time = clock;
  }
  for (int each = 0; each < recording->pairs; each++) {
    stage[each] = own[0];
  }
  stage[recording->pairs] = own[1];
  if (failed) {
    forget_run(recording);
    return mjb_error(recording->batch, 0);
  }
  return recording->lacks_memory ? "out of memory" : NULL;
}

static void exchange(mjtNum* target, const mjtNum* source, mjtNum* kept, size_t count) {
  copy(kept, target, count, sizeof(mjtNum));
  copy(target, source, count, sizeof(mjtNum));
}

static size_t state_size(const mjModel* m) { return 1 + m->nq + m->nv + m->na; }

static mjtNum* state_now(const Recording* recording, const mjModel* m) {
  return recording->loop.states + recording->step * state_size(m);
}

/* Write the state that the next step starts from. */
void start_step(Recording* recording, const mjModel* m, const mjData* d) {
  mjtNum* state = state_now(recording, m);
  recording->begun = 1;
  *state++ = d->time;
  state = copy(state, d->qpos, m->nq, sizeof(mjtNum));
  state = copy(state, d->qvel, m->nv, sizeof(mjtNum));
  copy(state, d->act, m->na, sizeof(mjtNum));
}

static int differs(const mjtNum* stored, const mjtNum* now, size_t count) {
  return count && memcmp(stored, now, count * sizeof(mjtNum));
}

/* Return what happened since the last step: see `Since` in reader.py. */
int look(const Recording* recording, const mjModel* m, const mjData* d) {
  if (!recording->begun) {
    return 1;
  }
  const mjtNum* state = state_now(recording, m);
  if (*state++ != d->time) {
    return 2;
  }
  if (differs(state, d->qpos, m->nq) || differs(state + m->nq, d->qvel, m->nv) ||
      differs(state + m->nq + m->nv, d->act, m->na)) {
    return 3;
  }
  return recording->step < recording->loop.room ? 0 : 4;
}

/* Read what acts in a step that somebody else made, or is about to make: all contacts, and what
 * sensors would measure. */
void read_acting(Recording* recording, const mjModel* m, mjData* d) {
  const size_t number = sizeof(mjtNum);
  const mjtNum own[] = {d->energy[0], d->energy[1]}, *start = state_now(recording, m) + 1;
  mjtNum *row = recording->loop.rows + recording->step * recording->width,
         *kept = recording->loop.kept;
  exchange(d->qpos, start, kept, m->nq);
  exchange(d->qvel, start + m->nq, kept + m->nq, m->nv);
  read_contacts(recording, m, d, row);
  mj_energyPos(m, d);
  mj_energyVel(m, d);
  row[2] = d->energy[1];
  row[3] = d->energy[0];
  row += 4;
  copy(d->energy, own, 2, number);
  copy(d->qpos, kept, m->nq, number);
  copy(d->qvel, kept + m->nq, m->nv, number);
  if (recording->free) {
    mj_subtreeVel(m, d);
    row = copy(row, d->subtree_linvel, 3, number);
    row = copy(row, d->subtree_angmom, 3, number);
  }
  if (recording->subject >= 0) {
    mjtNum between[3];
    mju_sub3(between, d->xpos + 3 * recording->subject, d->xpos + 3 * recording->holder);
    mju_mulMatTVec3(row, d->xmat + 9 * recording->holder, between);
    row = copy(row + 3, d->xquat + 4 * recording->holder, 4, number);
  }
  row = copy(row, d->actuator_force, m->nu, number);
  copy(row, d->ten_length, m->ntendon, number);
}

/* Read what a step left that was made. */
void read_left(Recording* recording, const mjModel* m, const mjData* d) {
  const Loop* loop = &recording->loop;
  for (int64_t each = 0; each < loop->fields; each++) {
    const Field* field = loop->field + each;
    memcpy(field->target + recording->step * field->size, field->source, field->size);
  }
  recording->step++;
  start_step(recording, m, d);
}

/* Read both, where all that acted in a step is kept. */
void read_step(Recording* recording, const mjModel* m, mjData* d) {
  read_acting(recording, m, d);
  read_left(recording, m, d);
}

/* Say where the next steps go. */
void set_loop(Recording* recording, const Loop* loop) { recording->loop = *loop; }

int steps_of(const Recording* recording) { return recording->step; }

/* Have the pairs found by their keys, with the memory that others had before. */
static void prepare_pairs(Recording* recording) {
  recording->last = -1;
  qsort(recording->pair, recording->pairs, sizeof(Pair), by_key);
  for (Pair* pair = recording->pair; pair < recording->pair + recording->pairs; pair++) {
    if (pair->number < spare.pairs) {
      Memory* memory = spare.memory + pair->number;
      pair->slots = memory->slots;
      pair->room = memory->room;
      *memory = (Memory){NULL, 0};
    }
  }
}

/* Keep the memory of slots for others, of which there is some for each pair at most. */
static void keep_memory(Recording* recording) {
  const size_t most = ((size_t)1 << 28) / (WIDTH * sizeof(mjtNum)); /* more is of one long run */
  if (recording->pairs > spare.pairs) {
    Memory* memory = realloc(spare.memory, recording->pairs * sizeof(Memory));
    if (memory) {
      memset(memory + spare.pairs, 0, (recording->pairs - spare.pairs) * sizeof(Memory));
      spare.memory = memory;
      spare.pairs = recording->pairs;
    }
  }
  for (Pair* pair = recording->pair; pair < recording->pair + recording->pairs; pair++) {
    Memory* memory = spare.memory + pair->number;
    if (pair->number < spare.pairs && pair->room > memory->room && pair->room <= most) {
      release_slots(memory->slots);
      *memory = (Memory){pair->slots, pair->room};
    } else {
      release_slots(pair->slots);
    }
  }
}

/* Return a recording of somebody else's steps, or NULL.
 *
 * Each pair is four numbers: whether sides are bodies, both, and slots. Bodies are -1 if none. */
Recording* open_loop(const int64_t* declared, int pairs, int width, int free_of_forces,
                     int subject, int holder) {
  Recording* recording = calloc(1, sizeof(Recording));
  Pair* pair = calloc(pairs + 1, sizeof(Pair));
  if (!recording || !pair) {
    free(recording);
    free(pair);
    return NULL;
  }
  *recording = (Recording){.pairs = pairs, .pair = pair, .width = width};
  recording->free = free_of_forces;
  recording->subject = subject;
  recording->holder = holder;
  for (int each = 0; each < pairs; each++, declared += 4) {
    uint64_t key = key_of(declared[0], declared[1], declared[2]);
    pair[each] = (Pair){.key = key, .first = declared[1], .most = declared[3], .number = each};
  }
  prepare_pairs(recording);
  return recording;
}

/* End a loop's recording, so that its slots can be filled; return whether memory sufficed. */
int end_loop(Recording* recording) {
  recording->steps = recording->step;
  return !recording->lacks_memory;
}

void close_recording(Recording* recording) {
  if (!recording) {
    return;
  }
  keep_memory(recording);
  mjb_deleteBatch(recording->batch);
  free(recording->pair);
  free(recording);
}

/* Return a recording of so many runs of one structure; NULL if there is no memory for it.
 *
 * The sensors of so many pairs follow each other, and that of all contacts follows them. */
Recording* open_recording(const mjModel* m, int sensor, int pairs, int runs, int steps) {
  Recording* recording = calloc(1, sizeof(Recording));
  Pair* pair = calloc(pairs + 1, sizeof(Pair));
  mjBatchConfig config;
  mjb_defaultConfig(&config);
  config.nthread = 1;
  mjBatch* batch = mjb_makeBatch(m, 1, &config, NULL, 0);
  if (!recording || !pair || !batch) {
    free(recording);
    free(pair);
    mjb_deleteBatch(batch);
    return NULL;
  }
  *recording = (Recording){.batch = batch, .pairs = pairs, .steps = steps, .pair = pair};
  recording->rows = (size_t)runs * steps;
  recording->sensor = sensor;
  recording->address = m->sensor_adr[sensor + pairs];
  recording->width = m->nsensordata - recording->address;
  for (int each = 0; each < pairs; each++) {
    int place = sensor + each, first = m->sensor_objid[place], second = m->sensor_refid[place];
    uint64_t key = key_of(m->sensor_objtype[place] == mjOBJ_BODY, first, second);
    const int most = m->sensor_dim[place] / WIDTH;
    pair[each] = (Pair){.key = key, .first = first, .most = most, .number = each};
  }
  prepare_pairs(recording);
  return recording;
}

/* Return the bytes that the slots of so many runs take, as many a step as are filled by now. */
size_t slot_bytes(const Recording* recording, int runs) {
  size_t widths = 0;
  for (int each = 0; each < recording->pairs; each++) {
    widths += recording->pair[each].width;
  }
  return widths * runs * recording->steps * WIDTH * sizeof(mjtNum);
}

/* Write where the slots of each pair (pairs) are, as they are declared, for so many runs, and how
 * many of them a step has; return whether there is memory for all. */
int find_slots(Recording* recording, int runs, mjtNum** slots, int64_t* widths) {
  for (Pair* pair = recording->pair; pair < recording->pair + recording->pairs; pair++) {
    const size_t count = (size_t)runs * recording->steps * pair->width;
    if (!make_room(recording, pair, count)) {
      return 0;
    }
    clear(pair, count);
    slots[pair->number] = pair->slots;
    widths[pair->number] = pair->width;
  }
  return 1;
}
