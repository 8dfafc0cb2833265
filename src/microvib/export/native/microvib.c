/* The wrapper of microvib's compiled drive (microvib.h says what it does). Everything that depends on
   the drive is in its image: numbers and arrays that the compiled functions take, found by name.
   docs/reference/export-interface.md describes the image. */

#include "microvib.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- The compiled functions: words of the arguments, words of the result; 0 where all went well ---- */

typedef int32_t compiled(const void *arguments, void *result);

#define HIDDEN __attribute__((visibility("hidden")))
HIDDEN compiled microvib_advance, microvib_snapshot, microvib_tabulate, microvib_linear_part, microvib_initial_friction;
#ifdef MICROVIB_TWO_PROCESSORS /* once more for x86-64 processors with AVX2 and fused products */
#include <cpuid.h>
HIDDEN compiled microvib_advance_v3, microvib_snapshot_v3, microvib_tabulate_v3, microvib_linear_part_v3,
    microvib_initial_friction_v3;
#endif
#ifdef MICROVIB_BUILT_IN
HIDDEN extern const uint64_t microvib_image[];
HIDDEN extern const uint64_t microvib_image_bytes;
#endif

/* ---- Format of an image ---- */

#define MAGIC INT64_C(0x004547414d49564d) /* "MVIMAGE" */
#define VERSION 1
#define NAME_BYTES 48

enum { H_MAGIC, H_VERSION, H_STORED, H_WORDS, H_ENTRIES, H_DIRECTORY, H_ADDRESSES, H_LIST, H_CHANGED, H_CHANGED_END, HEADER = 16 };
enum { NUMBER, ARRAY };

struct entry {
    char name[NAME_BYTES];
    int64_t kind, word, place, size; /* of an array: its record, and its data */
};

/* Kinds of outputs, and entries of clock and counters: as microvib.export.native.drive and
   microvib.solve.kernel have them. */
enum { INSTANT, MEAN, LOAD, LOAD_MEAN, ENERGY, COMMANDED };
enum { NOW = 0, WEIGHT = 8 };
enum { RATE_M = 5, RATE_L = 7, MODES = 8 }; /* in the state y */
enum { CHANNEL_T_D = 17 };
enum { OK, LOST_SYNCHRONISM, STEP_TOO_SMALL, NOT_FINITE };

/* Words of wrapper.state: part of a run's state, since time changes them. */
enum {
    STARTED,       /* a step was made: parameters are fixed */
    COMMAND,       /* who commands: */
    SINCE,         /* of a commanded rate: its beginning [s], */
    COUNT,         /* microsteps commanded there, */
    RATE,          /* and microsteps per second */
    TAKEN,         /* microsteps taken, of those that come by number */
    GIVEN,         /* a torque is given: the spacecraft was accelerated, or somebody pulls at the shaft, */
    SHAFT,         /* by this torque [N m] */
    GIVEN_MEAN,    /* mean of the torque against the output that is given */
    FIRST,         /* of a record: its beginning [s], */
    WIDTH,         /* interval [s], 0: none, */
    DONE,          /* and rows so far */
    HAS_MEAN,      /* the means are those of a step */
    KEPT,          /* the state at the last microstep is kept: the next step goes on from there */
    STATE_WORDS
};
enum { BY_PROFILE, BY_RATE, BY_NUMBER };
enum { TURN, CURRENT, RAMP, ON_TIME, PER_RATE };
enum { KNOT_RATE, OUTPUT_INERTIA, ROTOR_INERTIA, AXIS, SIX_KNOWN, COMPONENTS = 6 };

struct array {
    int64_t *record; /* data, dimensions, place of these, nothing, lengths; NULL of none */
    double *data;
    size_t size;
};

struct microvib {
    int64_t *image; /* relocated */
    char why[256];
    void *allocated;
    const struct entry *entries;
    size_t entry_count;
    compiled *advance, *snapshot, *tabulate, *linear_part, *initial_friction;
    void *advance_words, *snapshot_words;
    double *stop, *first, *width;
    double *y, *clock, *energy, *partial, *state, *means, *channels;
    double *hub, *integrals, *acceleration, *last; /* modes by the spacecraft's motion; its acceleration, and that in the last step */
    int64_t *cursor;
    struct array rows, due, references, noise[2], knots, legs, turn, weights, by_hub;
    double *command;
    const double *hub_numbers, *participation, *residual, *H, *D, *Lam, *inv_h;
    double *noise_rate[2]; /* of the steps, and of what is shown */
    const int64_t *places;
    const char *texts, *channel_texts, *parameter_texts;
    const int64_t *parameter_places;
    double *parameter_values;
    const double *packing;
    size_t parameters, outputs, modes, channel_count, columns;
    double own_noise_rate;
    struct array own_noise;
    int instant_is_known, independent;
    int64_t *kept; /* memory for a state */
};

static int fails(microvib *m, const char *text)
{
    snprintf(m->why, sizeof m->why, "%s", text);
    return 1;
}

/* ---- Opening ---- */

static const struct entry *find(const microvib *m, const char *name)
{
    for (size_t k = 0; k < m->entry_count; k++)
        if (strcmp(m->entries[k].name, name) == 0)
            return &m->entries[k];
    return NULL;
}

/* The word of a number, or the data of an array. */
static void *of(const microvib *m, const char *name)
{
    const struct entry *e = find(m, name);
    return e ? (void *)(m->image + (e->kind == NUMBER ? e->word : e->place)) : NULL;
}

static struct array array_of(const microvib *m, const char *name)
{
    const struct entry *e = find(m, name);
    struct array found = {NULL, NULL, 0};
    if (e) {
        found.record = e->word >= 0 ? m->image + e->word : NULL;
        found.data = (double *)(m->image + e->place);
        found.size = (size_t)e->size;
    }
    return found;
}

static int64_t address(const void *place)
{
    return (int64_t)(intptr_t)place;
}

/* Lengths of an array in its record. */
static int64_t *shape(struct array a)
{
    return a.record + 4;
}

#ifdef MICROVIB_TWO_PROCESSORS
/* Whether processor and system have AVX2 with fused products. */
static int has_wide_vectors(void)
{
    unsigned a, b, c, d, low, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_FMA) || !(c & bit_OSXSAVE) || !(c & bit_AVX))
        return 0;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if ((low & 6) != 6)
        return 0;
    return __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & bit_AVX2) && (b & bit_BMI) && (b & bit_BMI2);
}
#endif

#define CHOOSE(m, ending)                                        \
    ((m)->advance = microvib_advance##ending,                    \
     (m)->snapshot = microvib_snapshot##ending,                  \
     (m)->tabulate = microvib_tabulate##ending,                  \
     (m)->linear_part = microvib_linear_part##ending,            \
     (m)->initial_friction = microvib_initial_friction##ending)

static void choose_functions(microvib *m)
{
    CHOOSE(m, );
#ifdef MICROVIB_TWO_PROCESSORS
    if (has_wide_vectors())
        CHOOSE(m, _v3);
#endif
}

static const int64_t *built_in(size_t *bytes)
{
#ifdef MICROVIB_BUILT_IN
    *bytes = (size_t)microvib_image_bytes;
    return (const int64_t *)microvib_image;
#else
    *bytes = 0;
    return NULL;
#endif
}

/* Whether words from `first` on lie before `end`. */
static int within(int64_t first, int64_t count, int64_t end)
{
    return first >= 0 && count >= 0 && first <= end && count <= end - first;
}

/* The header of an image that is one, whole and of this version; else NULL. */
static const int64_t *checked(const void *image, size_t *bytes)
{
    const int64_t *h = image ? image : built_in(bytes);
    if (!h || *bytes < 8 * HEADER || h[H_MAGIC] != MAGIC || h[H_VERSION] != VERSION)
        return NULL;
    int64_t stored = h[H_STORED], entry = (int64_t)(sizeof(struct entry) / 8);
    if (stored < HEADER || stored > h[H_WORDS] || h[H_WORDS] > INT64_C(1) << 28 || (uint64_t)stored * 8 > *bytes)
        return NULL;
    if (!within(h[H_DIRECTORY], 0, stored) || h[H_ENTRIES] < 0 || h[H_ENTRIES] > (stored - h[H_DIRECTORY]) / entry)
        return NULL;
    if (!within(h[H_LIST], h[H_ADDRESSES], stored) || !within(h[H_CHANGED], h[H_CHANGED_END] - h[H_CHANGED], stored))
        return NULL;
    for (int64_t k = 0; k < h[H_ADDRESSES]; k++)
        if (!within(h[h[H_LIST] + k], 1, stored))
            return NULL;
    return h;
}

static size_t head_bytes(void)
{
    return (sizeof(microvib) + 63) / 64 * 64;
}

size_t microvib_memory(const void *image, size_t bytes)
{
    const int64_t *h = checked(image, &bytes);
    return h ? head_bytes() + 8 * (size_t)(h[H_WORDS] + h[H_CHANGED_END] - h[H_CHANGED]) + 63 : 0;
}

static void find_all(microvib *m)
{
    m->advance_words = of(m, "advance");
    m->snapshot_words = of(m, "snapshot");
    m->stop = of(m, "advance.stop");
    m->first = of(m, "advance.out.first");
    m->width = of(m, "advance.out.width");
    m->y = of(m, "advance.x.y");
    m->clock = of(m, "advance.x.clock");
    m->energy = of(m, "advance.x.energy");
    m->partial = of(m, "advance.out.partial");
    m->cursor = of(m, "advance.out.cursor");
    m->rows = array_of(m, "advance.out.rows");
    m->means = m->rows.data;
    m->due = array_of(m, "advance.steps_t");
    m->references = array_of(m, "advance.steps_ref");
    m->noise[0] = m->own_noise = array_of(m, "advance.p.noise");
    m->noise[1] = array_of(m, "snapshot.p.noise");
    m->noise_rate[0] = of(m, "advance.p.noise_rate");
    m->noise_rate[1] = of(m, "snapshot.p.noise_rate");
    m->own_noise_rate = *m->noise_rate[0];
    m->H = of(m, "advance.p.H");
    m->D = of(m, "advance.p.D");
    m->Lam = of(m, "advance.p.Lam");
    m->inv_h = of(m, "advance.p.inv_h");
    m->modes = find(m, "advance.p.H")->size;
    m->channels = of(m, "snapshot.out");
    m->channel_count = find(m, "snapshot.out")->size;
    m->columns = m->rows.size;
    m->state = of(m, "wrapper.state");
    m->hub = of(m, "wrapper.hub");
    m->integrals = m->hub + 2 * m->modes;
    m->acceleration = m->integrals + m->modes;
    m->last = m->acceleration + COMPONENTS;
    m->participation = of(m, "hub.participation");
    m->residual = of(m, "hub.residual");
    m->knots = array_of(m, "hub.knots");
    m->hub_numbers = of(m, "hub.numbers");
    m->by_hub = array_of(m, "hub.loads");
    m->legs = array_of(m, "command.legs");
    m->turn = array_of(m, "command.references");
    m->command = of(m, "command.numbers");
    m->weights = array_of(m, "outputs.weights");
    m->places = of(m, "outputs.places");
    m->outputs = find(m, "outputs.places")->size / 2;
    m->texts = of(m, "outputs.texts");
    m->channel_texts = of(m, "channels.texts");
    m->parameters = find(m, "parameters.values")->size / 2;
    m->parameter_texts = of(m, "parameters.texts");
    m->parameter_places = of(m, "parameters.places");
    m->parameter_values = of(m, "parameters.values");
    m->packing = of(m, "parameters.packing");
}

microvib *microvib_open(const void *image, size_t bytes, void *memory, char *why, size_t room)
{
    const int64_t *h = checked(image, &bytes);
    if (!h) {
        if (room)
            snprintf(why, room, "the image is none of microvib's, cut off, or of another version than %d", VERSION);
        return NULL;
    }
    microvib *m = (microvib *)(((uintptr_t)memory + 63) / 64 * 64);
    memset(m, 0, sizeof *m);
    int64_t *base = m->image = (int64_t *)((char *)m + head_bytes());
    m->kept = base + h[H_WORDS];
    memcpy(base, h, 8 * (size_t)h[H_STORED]);
    memset(base + h[H_STORED], 0, 8 * (size_t)(h[H_WORDS] - h[H_STORED]));
    for (int64_t k = 0; k < h[H_ADDRESSES]; k++)
        base[h[h[H_LIST] + k]] += address(base);
    m->entries = (const struct entry *)(base + h[H_DIRECTORY]);
    m->entry_count = (size_t)h[H_ENTRIES];
    choose_functions(m);
    find_all(m);
    m->tabulate(of(m, "tabulate"), NULL);
    return m;
}

microvib *microvib_new(char *why, size_t room)
{
    size_t bytes = microvib_memory(NULL, 0);
    void *memory = bytes ? malloc(bytes) : NULL;
    if (bytes && !memory) {
        if (room)
            snprintf(why, room, "there is no memory for a drive, which takes %zu bytes", bytes);
        return NULL;
    }
    microvib *m = microvib_open(NULL, 0, memory, why, room);
    if (m)
        m->allocated = memory;
    return m;
}

void microvib_free(microvib *m)
{
    if (m)
        free(m->allocated);
}

const char *microvib_error(const microvib *m)
{
    return m->why;
}

/* ---- Command: when microsteps come, and what the references are after each ---- */

/* A stretch of constant acceleration: when it begins and ends [s], commanded angle [microsteps] and rate
   at its beginning, and the slope of the rate. */
struct leg {
    double begins, ends, count, rate, slope;
};

/* The leg of the command at a time, as solve/command.py has it. */
static struct leg leg_at(const microvib *m, double t)
{
    struct leg found = {m->state[SINCE], INFINITY, m->state[COUNT], m->state[RATE], 0.0};
    if (m->state[COMMAND] != BY_PROFILE)
        return found;
    size_t n = m->legs.size / 3, k = n - 1;
    const double *times = m->legs.data, *rates = times + n, *counts = rates + n;
    while (k > 0 && times[k] > t)
        k--;
    found.begins = times[k];
    found.count = counts[k];
    found.rate = rates[k];
    if (k + 1 < n) {
        double span = times[k + 1] - times[k];
        found.ends = times[k + 1];
        found.slope = span > 0.0 ? (rates[k + 1] - rates[k]) / span : 0.0;
    }
    return found;
}

static double count_at(struct leg leg, double t)
{
    double dt = t - leg.begins;
    return leg.count + dt * (leg.rate + 0.5 * leg.slope * dt);
}

/* A count; an odd half where rounding may have put it just beside one. */
static double snapped(double count)
{
    double half = floor(count) + 0.5;
    return fabs(count - half) <= 1e-14 * (1.0 + fabs(count)) ? half : count;
}

/* Add the microstep after which the rotor is commanded to `count`, at the time `t` and the rate
   `rate`, in microsteps per second. */
static void add_microstep(microvib *m, size_t number, double t, double count, double rate)
{
    double *row = m->references.data + 4 * number;
    double turn = m->command[TURN], angle = 2.0 * 3.141592653589793 * count / turn;
    if (m->turn.size > 0) {
        double at = count - turn * floor(count / turn);
        memcpy(row, m->turn.data + 2 * (size_t)at, 2 * sizeof *row);
    } else {
        row[0] = m->command[CURRENT] * cos(angle);
        row[1] = m->command[CURRENT] * sin(angle);
    }
    row[2] = angle;
    row[3] = m->command[RAMP] > 0.0 && rate > 0.0 ? m->command[RAMP] / rate : 0.0;
    if (m->command[ON_TIME] > 0.0)
        row[3] = m->command[ON_TIME];
    m->due.data[number] = t;
}

/* Microsteps from the time `a` to `b` of a leg, between which the rate keeps its sign, behind the
   `number` that are there; `b` is put back to the first that finds no room. */
static size_t add_crossings(microvib *m, size_t number, struct leg leg, double a, double *b)
{
    double from = snapped(count_at(leg, a)), to = snapped(count_at(leg, *b));
    double rate = leg.rate + leg.slope * (a - leg.begins), way = to >= from ? 1.0 : -1.0;
    double level = way > 0.0 ? ceil(from - 0.5) + 0.5 : floor(from + 0.5) - 0.5;
    double latest = nextafter(*b, a);
    for (; way > 0.0 ? level < to : level > to; level += way) {
        double rise = level - from, root = sqrt(fmax(rate * rate + 2.0 * leg.slope * rise, 0.0));
        double t = rise == 0.0 ? a : a + 2.0 * rise / (rate + copysign(root, way));
        t = fmin(fmax(t, a), latest);
        if (number == m->due.size) {
            *b = t;
            return number;
        }
        add_microstep(m, number++, t, level + 0.5 * way, root);
    }
    return number;
}

/* Microsteps from now to `*stop`, which is put back where there are too many; how many. */
static size_t microsteps_due(microvib *m, double *stop)
{
    double now = m->clock[NOW];
    size_t number = 0;
    if (m->state[COMMAND] == BY_NUMBER) {
        while (m->state[TAKEN] != m->state[COUNT] && number < m->due.size) {
            m->state[TAKEN] += m->state[TAKEN] < m->state[COUNT] ? 1.0 : -1.0;
            add_microstep(m, number++, now, m->state[TAKEN], 0.0);
        }
        return number;
    }
    for (double a = now; a < *stop;) {
        struct leg leg = leg_at(m, a);
        double b = fmin(leg.ends, *stop);
        if (leg.slope != 0.0) { /* the rate may pass zero */
            double turns = leg.begins - leg.rate / leg.slope;
            if (a < turns && turns < b)
                b = turns;
        }
        double wanted = b;
        number = add_crossings(m, number, leg, a, &b);
        if (b < wanted) {
            *stop = b;
            break;
        }
        a = b;
    }
    return number;
}

/* ---- The spacecraft's motion ----

   Where the interface is accelerated by a (six components, axes of the array), everything on it feels
   -M a. The modes are linear: what they do by a alone, with the output held, adds to what they do by the
   output. It is known in closed form, since a is constant within a step; its torque on the output, and
   that of the rigid inertias, is handed to the equations in place of torque noise, which is just such a
   given torque, together with what others put on the output shaft. The rotor's own inertia acts at the
   output, through the ratio. */

struct oscillator {
    double eta, rate;
};

/* A mode a time `dt` later (or earlier), free or under a constant force. */
static struct oscillator later(struct oscillator x, double dt, double damping, double square, double force)
{
    double rest = square > 0.0 ? force / square : 0.0, half = 0.5 * damping;
    double e = exp(-half * dt), left = square - half * half, c, s;
    struct oscillator after;
    if (left > 0.0) {
        double w = sqrt(left);
        c = cos(w * dt);
        s = sin(w * dt) / w;
    } else {
        double w = sqrt(-left);
        c = 0.5 * (exp(w * dt) + exp(-w * dt));
        s = w * fabs(dt) > 1e-6 ? 0.5 * (exp(w * dt) - exp(-w * dt)) / w : dt;
    }
    x.eta -= rest;
    after.eta = rest + e * (x.eta * (c + half * s) + x.rate * s);
    after.rate = e * (x.rate * (c - half * s) - square * x.eta * s);
    return after;
}

static struct oscillator hub_mode(const microvib *m, size_t k)
{
    struct oscillator x = {m->hub[2 * k], m->hub[2 * k + 1]};
    return x;
}

static double hub_force(const microvib *m, size_t k)
{
    double total = 0.0;
    for (size_t j = 0; j < COMPONENTS; j++)
        total -= m->participation[j * m->modes + k] * m->acceleration[j];
    return total;
}

static double about_axis(const microvib *m, const double acceleration[COMPONENTS])
{
    return acceleration[(int)m->hub_numbers[AXIS]];
}

/* Torque of rigid inertias against the output, by the acceleration, less that of others on the shaft. */
static double rigid_torque(const microvib *m)
{
    double G = -*m->inv_h, total = m->hub_numbers[ROTOR_INERTIA] * about_axis(m, m->acceleration) / G;
    for (int j = 0; j < COMPONENTS; j++)
        total += m->residual[j] * m->acceleration[j];
    return total - m->state[SHAFT];
}

/* That torque and that of the modes, now. */
static double hub_torque(const microvib *m)
{
    double torque = rigid_torque(m);
    for (size_t k = 0; k < m->modes; k++)
        torque -= m->H[k] * (m->D[k] * m->hub[2 * k + 1] + m->Lam[k] * m->hub[2 * k]);
    return torque;
}

/* Value and slope [1/s] of the drive's own torque noise. */
static void own_noise(const microvib *m, double t, double *value, double *slope)
{
    int64_t count = (int64_t)m->own_noise.size / 2;
    *value = *slope = 0.0;
    if (count == 0)
        return;
    double x = t * m->own_noise_rate, knot = floor(x + 1e-9), u = x - knot;
    int64_t a = (int64_t)knot % count, b;
    a = a < 0 ? a + count : a;
    b = (a + 1) % count;
    const double *n = m->own_noise.data;
    double v0 = n[2 * a], d0 = n[2 * a + 1], rise = n[2 * b] - v0, d1 = n[2 * b + 1];
    double square = 3.0 * rise - 2.0 * d0 - d1, cube = d0 + d1 - 2.0 * rise;
    *value = v0 + u * (d0 + u * (square + u * cube));
    *slope = m->own_noise_rate * (d0 + u * (2.0 * square + 3.0 * u * cube));
}

/* Fill the knots of the torque from now on, and put `*stop` back to where they end. */
static void fill_knots(microvib *m, double *stop)
{
    double rate = m->hub_numbers[KNOT_RATE], now = m->clock[NOW];
    int64_t count = (int64_t)m->knots.size / 2, first = (int64_t)floor(now * rate) - 1;
    int64_t last = (int64_t)ceil(*stop * rate) + 1;
    if (last - first >= count) {
        last = first + count - 1;
        *stop = (double)(last - 1) / rate;
    }
    for (int64_t j = first; j <= last; j++) {
        double *knot = m->knots.data + 2 * (j % count < 0 ? j % count + count : j % count);
        own_noise(m, (double)j / rate, &knot[0], &knot[1]);
        knot[0] += rigid_torque(m);
        knot[1] /= rate; /* slopes are by knots */
    }
    for (size_t k = 0; k < m->modes; k++) {
        double D = m->D[k], Lam = m->Lam[k], force = hub_force(m, k);
        struct oscillator x = later(hub_mode(m, k), (double)first / rate - now, D, Lam, force);
        for (int64_t j = first; j <= last; j++) {
            double *knot = m->knots.data + 2 * (j % count < 0 ? j % count + count : j % count);
            double second = force - D * x.rate - Lam * x.eta;
            knot[0] -= m->H[k] * (D * x.rate + Lam * x.eta);
            knot[1] -= m->H[k] * (D * second + Lam * x.rate) / rate;
            x = later(x, 1.0 / rate, D, Lam, force);
        }
    }
}

/* What the spacecraft's motion has made of its modes at the time `stop`, of the torque's integral, and
   of the integrals of the modes' second derivatives (in `hub` behind the modes' states). */
static void move_hub(microvib *m, double stop)
{
    double dt = stop - m->clock[NOW];
    m->state[GIVEN_MEAN] += dt * rigid_torque(m);
    for (size_t k = 0; k < m->modes; k++) {
        struct oscillator before = hub_mode(m, k), after;
        after = later(before, dt, m->D[k], m->Lam[k], hub_force(m, k));
        double change = after.rate - before.rate; /* = -(integral of what pulls) + that of the force */
        m->state[GIVEN_MEAN] += m->H[k] * (change - hub_force(m, k) * dt);
        m->hub[2 * k] = after.eta;
        m->hub[2 * k + 1] = after.rate;
        m->integrals[k] += change;
    }
}

/* ---- Steps ---- */

static void point_to(struct array a, const void *data, size_t length)
{
    a.record[0] = address(data);
    shape(a)[0] = (int64_t)length;
}

static int said(microvib *m, int64_t status)
{
    char text[200];
    const char *what = "the solution is not finite";
    if (status == LOST_SYNCHRONISM)
        what = "loss of synchronism: the rotor is half an electrical period away from its commanded angle";
    if (status == STEP_TOO_SMALL)
        what = "the step became too small";
    snprintf(text, sizeof text, "simulation stopped at t = %.6g s: %s", m->clock[NOW], what);
    return fails(m, text);
}

/* What time changes. */
static int64_t *changed(const microvib *m, size_t *bytes)
{
    *bytes = 8 * (size_t)(m->image[H_CHANGED_END] - m->image[H_CHANGED]);
    return m->image + m->image[H_CHANGED];
}

/* Advance to `until` with the microsteps that were found, from the number `first` on. */
static int run(microvib *m, double until, size_t first, size_t due)
{
    int64_t status = 0;
    point_to(m->due, m->due.data + first, due - first);
    point_to(m->references, m->references.data + 4 * first, due - first);
    *m->stop = until;
    m->advance(m->advance_words, &status);
    return status == OK ? 0 : said(m, status);
}

/* Whether steps shall be those that the motion alone makes: no input may change between communications. */
static int goes_alone(const microvib *m)
{
    return m->independent && m->state[GIVEN] == 0.0 && m->state[COMMAND] != BY_NUMBER;
}

/* Advance to `stop`, and fill what rows there are; where the motion `goes_alone`, by way of the last
   microstep before it, where a step ends anyway, and keep the state there. */
static int advance(microvib *m, double stop)
{
    size_t bytes;
    const int64_t *state = changed(m, &bytes);
    int alone = goes_alone(m) && m->state[WIDTH] == 0.0;
    m->instant_is_known = 0;
    m->state[STARTED] = 1.0;
    while (m->clock[NOW] < stop) {
        double until = stop;
        if (m->state[GIVEN] != 0.0)
            fill_knots(m, &until);
        size_t due = microsteps_due(m, &until), first = 0;
        if (m->state[GIVEN] != 0.0)
            move_hub(m, until);
        if (alone && until == stop) {
            if (due > 0 && m->due.data[due - 1] > m->clock[NOW]) {
                first = due - 1;
                if (run(m, m->due.data[first], 0, due))
                    return 1;
            }
            memcpy(m->kept, state, bytes);
            m->state[KEPT] = 1.0;
        }
        if (run(m, until, first, due))
            return 1;
    }
    return 0;
}

static int refuse_past(microvib *m, double stop)
{
    char text[160];
    snprintf(text, sizeof text, "the time %.17g s is not after the present one, %.17g s", stop, m->clock[NOW]);
    return fails(m, text);
}

/* The integrals of what the spacecraft's motion made, over `span`, as means. */
static void end_hub_means(microvib *m, double span)
{
    m->state[GIVEN_MEAN] /= span;
    for (size_t k = 0; k < m->modes; k++)
        m->integrals[k] /= span;
}

static void begin_hub_means(microvib *m)
{
    m->state[GIVEN_MEAN] = 0.0;
    memset(m->integrals, 0, m->modes * sizeof *m->integrals);
    memcpy(m->last, m->acceleration, COMPONENTS * sizeof *m->last);
}

/* Angular momentum of all that moves about the drive axis. */
static double momentum(const microvib *m)
{
    double total = m->hub_numbers[ROTOR_INERTIA] * m->y[RATE_M] + m->hub_numbers[OUTPUT_INERTIA] * m->y[RATE_L];
    for (size_t k = 0; k < m->modes; k++)
        total += m->H[k] * m->y[MODES + 2 * k + 1];
    return total;
}

int microvib_do_step(microvib *m, double stop)
{
    double now = m->clock[NOW], before = momentum(m);
    m->why[0] = 0;
    if (!isfinite(stop) || stop < now)
        return refuse_past(m, stop);
    if (stop == now)
        return 0;
    if (m->state[WIDTH] > 0.0)
        return fails(m, "a record has begun: call microvib_record, or end it by microvib_begin_record with a width of 0");
    if (m->state[KEPT] != 0.0) {
        size_t bytes;
        int64_t *to = changed(m, &bytes);
        memcpy(to, m->kept, bytes);
    }
    *m->first = now;
    *m->width = stop - now;
    m->clock[WEIGHT] = 0.0;
    memset(m->partial, 0, m->columns * sizeof *m->partial);
    m->cursor[0] = m->cursor[1] = 0;
    point_to(m->rows, m->means, 1);
    begin_hub_means(m);
    int failed = advance(m, stop);
    if (!failed) {
        end_hub_means(m, stop - now);
        m->means[CHANNEL_T_D] = -(momentum(m) - before) / (stop - now); /* exact, where the row has a quadrature */
    }
    m->state[HAS_MEAN] = failed || m->cursor[0] != 1 ? 0.0 : 1.0;
    return failed;
}

int microvib_begin_record(microvib *m, double first, double width)
{
    double now = m->clock[NOW];
    m->why[0] = 0;
    if (!isfinite(first) || !isfinite(width) || first < now)
        return refuse_past(m, first);
    m->state[HAS_MEAN] = m->state[DONE] = m->state[KEPT] = 0.0;
    m->state[FIRST] = *m->first = first;
    m->state[WIDTH] = width > 0.0 ? width : 0.0;
    *m->width = width > 0.0 ? width : 1.0;
    m->clock[WEIGHT] = 0.0;
    memset(m->partial, 0, m->columns * sizeof *m->partial);
    m->cursor[0] = m->cursor[1] = 0;
    point_to(m->rows, m->means, 0);
    return advance(m, first);
}

int microvib_record(microvib *m, size_t count, double *rows)
{
    m->why[0] = 0;
    m->state[KEPT] = 0.0;
    if (!(m->state[WIDTH] > 0.0))
        return fails(m, "no record has begun: call microvib_begin_record first");
    *m->first = m->state[FIRST];
    *m->width = m->state[WIDTH];
    m->cursor[0] = 0;
    m->cursor[1] = (int64_t)m->state[DONE];
    point_to(m->rows, rows, count);
    m->state[DONE] += (double)count;
    int failed = advance(m, m->state[FIRST] + m->state[DONE] * m->state[WIDTH]);
    if (!failed && m->cursor[0] != (int64_t)count)
        failed = fails(m, "the record is not whole: its intervals are too short for its time");
    return failed;
}

/* ---- Inputs ---- */

/* Give the equations their torque noise, or the knots that have it and the spacecraft's motion. */
static void take_noise(microvib *m)
{
    int acts = m->state[GIVEN] != 0.0;
    struct array from = acts ? m->knots : m->own_noise;
    double rate = acts ? m->hub_numbers[KNOT_RATE] : m->own_noise_rate;
    for (int k = 0; k < 2; k++) {
        point_to(m->noise[k], from.data, from.size);
        *m->noise_rate[k] = rate;
    }
}

int microvib_set_independent(microvib *m, int on)
{
    m->why[0] = 0;
    if (m->state[STARTED] != 0.0)
        return fails(m, "independent steps can be asked for before the first step alone");
    m->independent = on != 0;
    return 0;
}

double microvib_time(const microvib *m)
{
    return m->clock[NOW];
}

int64_t microvib_microsteps(const microvib *m)
{
    double now = m->clock[NOW];
    if (m->state[COMMAND] == BY_NUMBER)
        return (int64_t)m->state[COUNT];
    return (int64_t)ceil(snapped(count_at(leg_at(m, now), now)) - 0.5);
}

int microvib_set_rate(microvib *m, double rate)
{
    double now = m->clock[NOW], per_second = rate * m->command[PER_RATE];
    if (!isfinite(rate))
        return fails(m, "the rate is not a finite number");
    if (m->state[COMMAND] == BY_RATE && per_second == m->state[RATE])
        return 0;
    m->state[KEPT] = 0.0;
    m->state[COUNT] = m->state[COMMAND] == BY_NUMBER ? m->state[COUNT] : count_at(leg_at(m, now), now);
    m->state[SINCE] = now;
    m->state[RATE] = per_second;
    m->state[COMMAND] = BY_RATE;
    return 0;
}

int microvib_set_microsteps(microvib *m, int64_t count)
{
    if (m->state[COMMAND] != BY_NUMBER)
        m->state[TAKEN] = (double)microvib_microsteps(m);
    m->state[COMMAND] = BY_NUMBER;
    m->state[KEPT] = 0.0;
    m->state[COUNT] = (double)count;
    m->state[SINCE] = m->clock[NOW];
    return 0;
}

/* Set something that acts from outside: the torque on the shaft, or a component of the acceleration. */
static int give(microvib *m, double *what, double value)
{
    m->why[0] = 0;
    if (!isfinite(value))
        return fails(m, what == m->state + SHAFT ? "the torque on the shaft is not a finite number"
                                                 : "the spacecraft's acceleration is not a finite number");
    if (value == *what)
        return 0;
    m->instant_is_known = 0;
    *what = value;
    m->state[KEPT] = 0.0;
    m->state[GIVEN] = 1.0; /* for good: scratch of the equations remembers it */
    take_noise(m);
    return 0;
}

int microvib_set_hub_acceleration(microvib *m, double acceleration)
{
    return give(m, m->acceleration + (int)m->hub_numbers[AXIS], acceleration);
}

int microvib_set_interface_acceleration(microvib *m, int component, double acceleration)
{
    if (component < 0 || component >= COMPONENTS)
        return fails(m, "the interface has components 0 to 5: along x, y, z, and about x, y, z");
    if (component != (int)m->hub_numbers[AXIS] && m->hub_numbers[SIX_KNOWN] == 0.0)
        return fails(m, "this array is known about its drive axis alone: export it with array.rigid_body and six components of its modes");
    return give(m, m->acceleration + component, acceleration);
}

int microvib_set_shaft_torque(microvib *m, double torque)
{
    return give(m, m->state + SHAFT, torque);
}

/* ---- Outputs ---- */

static const char *text(const char *all, size_t which)
{
    while (which--)
        all += strlen(all) + 1;
    return all;
}

size_t microvib_outputs(const microvib *m)
{
    return m->outputs;
}

const char *microvib_output_name(const microvib *m, size_t which)
{
    return which < m->outputs ? text(m->texts, 3 * which) : NULL;
}

const char *microvib_output_unit(const microvib *m, size_t which)
{
    return which < m->outputs ? text(m->texts, 3 * which + 1) : NULL;
}

const char *microvib_output_meaning(const microvib *m, size_t which)
{
    return which < m->outputs ? text(m->texts, 3 * which + 2) : NULL;
}

int microvib_find_output(const microvib *m, const char *name)
{
    for (size_t k = 0; k < m->outputs; k++)
        if (strcmp(name, microvib_output_name(m, k)) == 0)
            return (int)k;
    return -1;
}

size_t microvib_columns(const microvib *m)
{
    return m->columns;
}

const char *microvib_channel_name(const microvib *m, size_t column)
{
    return column < m->columns ? text(m->channel_texts, column) : NULL;
}

/* T_d of the equations is that of motions relative to the spacecraft; what is missing of the momentum's
   rate of change is what its acceleration makes of inertias and modes. */
static double torque_by_hub(const microvib *m, int mean)
{
    double G = -*m->inv_h, a = about_axis(m, mean ? m->last : m->acceleration);
    double torque = mean ? m->state[GIVEN_MEAN] : hub_torque(m), J = m->hub_numbers[ROTOR_INERTIA];
    return -(torque - J * a / G) - J * a;
}

static double sum(const double *weights, const double *values, size_t count)
{
    double total = 0.0;
    for (size_t k = 0; k < count; k++)
        total += weights[k] * values[k];
    return total;
}

/* A load, of channels at an instant or their means; `second` are the modes' second derivatives by the
   spacecraft's motion. */
static double load(const microvib *m, size_t row, const double *values, int mean)
{
    const double *weights = m->weights.data + row * m->channel_count;
    const double *by_hub = m->by_hub.data + row * (m->modes + COMPONENTS);
    double total = sum(weights, values, m->channel_count);
    if (m->state[GIVEN] == 0.0)
        return total;
    if (weights[CHANNEL_T_D] == 1.0) /* the drive axis */
        return total + torque_by_hub(m, mean);
    for (size_t k = 0; k < m->modes; k++) {
        double second = m->integrals[k];
        if (!mean)
            second = hub_force(m, k) - m->D[k] * m->hub[2 * k + 1] - m->Lam[k] * m->hub[2 * k];
        total += by_hub[k] * second;
    }
    return total + sum(by_hub + m->modes, mean ? m->last : m->acceleration, COMPONENTS);
}

static double hub_part(const microvib *m, size_t channel, int mean)
{
    if (m->state[GIVEN] == 0.0)
        return 0.0;
    if (channel == CHANNEL_T_D || channel == CHANNEL_T_D + 1)
        return torque_by_hub(m, mean);
    return 0.0;
}

double microvib_output(microvib *m, size_t which)
{
    if (which >= m->outputs)
        return NAN;
    int64_t kind = m->places[2 * which];
    size_t index = (size_t)m->places[2 * which + 1];
    if ((kind == MEAN || kind == LOAD_MEAN) && m->state[HAS_MEAN] == 0.0)
        kind = kind == MEAN ? INSTANT : LOAD; /* no step yet */
    if ((kind == INSTANT || kind == LOAD) && !m->instant_is_known) {
        if (m->state[GIVEN] != 0.0) {
            double until = m->clock[NOW];
            fill_knots(m, &until);
        }
        m->snapshot(m->snapshot_words, NULL);
        m->instant_is_known = 1;
    }
    switch (kind) {
    case INSTANT:
        return m->channels[index] + hub_part(m, index, 0);
    case MEAN:
        return m->means[index] + hub_part(m, index, 1);
    case LOAD:
        return load(m, index, m->channels, 0);
    case LOAD_MEAN:
        return load(m, index, m->means, 1);
    case ENERGY:
        return m->energy[index];
    default:
        return (double)microvib_microsteps(m);
    }
}

/* ---- State ---- */

size_t microvib_state_bytes(const microvib *m)
{
    size_t bytes;
    changed(m, &bytes);
    return m->independent ? 2 * bytes : bytes;
}

void microvib_get_state(const microvib *m, void *state)
{
    size_t bytes;
    const int64_t *from = changed(m, &bytes);
    memcpy(state, from, bytes);
    if (m->independent)
        memcpy((char *)state + bytes, m->kept, bytes);
}

int microvib_set_state(microvib *m, const void *state)
{
    size_t bytes;
    int64_t *to = changed(m, &bytes);
    m->why[0] = 0;
    memcpy(to, state, bytes);
    if (m->independent)
        memcpy(m->kept, (const char *)state + bytes, bytes);
    m->instant_is_known = 0;
    *m->first = m->state[FIRST];
    *m->width = m->state[WIDTH] > 0.0 ? m->state[WIDTH] : 1.0;
    take_noise(m);
    return 0;
}

/* ---- Parameters ----

   What hangs on them is made anew, as solve/pack.py makes it: numbers of the drive wherever a call has
   them, the linear part and its tables, and the friction's modes at rest. */

enum { FIELD, DAMPING, MICROSTEPS_PER_STEP, ARRAY_RATE };
enum { CURRENT_SIZE, INTEGRAL_SIZE, FULL_STEP, RATIO, ROTOR_RATE, OUTPUT_LEFT, MOST_LEVELS, SHORTEST, MICROSTEPS };
enum { STATES = 8, PATTERNS = 4, INPUTS = 6, IA = 0, IB, XA, XB, TM, WM, TL, WL };

size_t microvib_parameters(const microvib *m)
{
    return m->parameters;
}

const char *microvib_parameter_name(const microvib *m, size_t which)
{
    return which < m->parameters ? text(m->parameter_texts, 4 * which) : NULL;
}

double microvib_parameter(const microvib *m, size_t which)
{
    return which < m->parameters ? m->parameter_values[2 * which] : NAN;
}

/* Set a number of the drive in the arguments of a call, if it is there. */
static void set_in(microvib *m, const char *call, const char *field, double value)
{
    char name[NAME_BYTES];
    snprintf(name, sizeof name, "%s.%s", call, field);
    double *word = of(m, name);
    if (word)
        *word = value;
}

static void set_field(microvib *m, const char *field, double value)
{
    static const char *const linear[] = {"K_g", "C_g", "m_viscous", "l_viscous"};
    static const char *const calls[] = {"advance.p", "snapshot.p", "tabulate.p", "linear_part.modes", "initial_friction.p"};
    for (size_t k = 0; k < sizeof calls / sizeof *calls; k++)
        set_in(m, calls[k], field, value);
    for (size_t k = 0; k < sizeof linear / sizeof *linear; k++)
        if (strcmp(field, linear[k]) == 0)
            set_in(m, "linear_part.p", field, value);
}

static double field(const microvib *m, const char *name)
{
    char whole[NAME_BYTES];
    snprintf(whole, sizeof whole, "advance.p.%s", name);
    return *(double *)of(m, whole);
}

/* What a microstep moves, as its inverse: of all states, 0 for what no gain moves. */
static void inverse_sizes(const microvib *m, double microsteps, double per_size[STATES])
{
    const double *k = m->packing;
    double step = k[FULL_STEP] / microsteps, angle = step / k[RATIO], slower = k[ROTOR_RATE];
    double K_g = field(m, "K_g");
    if (K_g > 0.0) /* not rigid */
        slower = fmin(slower, sqrt(K_g / k[OUTPUT_LEFT]));
    per_size[IA] = per_size[IB] = 1.0 / k[CURRENT_SIZE];
    per_size[XA] = per_size[XB] = 1.0 / k[INTEGRAL_SIZE];
    per_size[TM] = 1.0 / step;
    per_size[WM] = 1.0 / (step * k[ROTOR_RATE]);
    per_size[TL] = 1.0 / angle;
    per_size[WL] = 1.0 / (angle * slower);
}

/* The fastest rate of the linear part, and of friction that falls. */
static double fastest(const microvib *m, const double *A, const double per_size[STATES])
{
    double most = 0.0, inertia = field(m, "J_L"), J_m = field(m, "J_m");
    int rigid = field(m, "K_g") == 0.0;
    for (int row = 0; row < PATTERNS * STATES; row++) {
        double total = 0.0;
        for (int j = 0; j < STATES; j++)
            if (per_size[j] > 0.0)
                total += fabs(A[row * STATES + j]) * per_size[row % STATES] / per_size[j];
        most = fmax(most, total);
    }
    if (rigid)
        inertia = fmax(inertia, J_m);
    if (J_m > 0.0)
        most = fmax(most, field(m, "m_stribeck") * field(m, "m_inv_rate") / J_m);
    if (inertia > 0.0)
        most = fmax(most, field(m, "l_stribeck") * field(m, "l_inv_rate") / inertia);
    return most;
}

/* Rates within which friction falls: the largest errors that are let pass near a stop. */
static void set_layers(microvib *m, const double per_size[STATES])
{
    static const int inputs[INPUTS] = {IA, IB, WM, WL, XA, XB};
    double *sizes = array_of(m, "advance.t.per_size").data, *layers = array_of(m, "advance.t.per_layer").data;
    double rotor = field(m, "m_stribeck") > 0.0 ? field(m, "m_inv_rate") : 0.0;
    double output = field(m, "l_stribeck") > 0.0 ? field(m, "l_inv_rate") : 0.0;
    if (field(m, "K_g") == 0.0)
        rotor = fmax(rotor, output * fabs(*m->inv_h));
    for (int k = 0; k < INPUTS; k++)
        layers[k] = sizes[k] = per_size[inputs[k]];
    layers[2] = fmax(layers[2], rotor);
    layers[3] = fmax(layers[3], output);
}

static double microsteps_of(const microvib *m)
{
    double found = m->packing[MICROSTEPS];
    for (size_t k = 0; k < m->parameters; k++)
        if (m->parameter_places[3 * k] == MICROSTEPS_PER_STEP)
            found = m->parameter_values[2 * k];
    return found;
}

static int renew_tables(microvib *m)
{
    double *A = array_of(m, "advance.t.A").data, *columns = array_of(m, "advance.t.columns").data;
    double per_size[STATES], longest = *(double *)of(m, "advance.t.longest");
    struct array sums = array_of(m, "advance.t.sums");
    m->linear_part(of(m, "linear_part"), NULL);
    for (int k = 0; k < PATTERNS; k++)
        for (int i = 0; i < STATES; i++)
            for (int j = 0; j < STATES; j++)
                columns[(k * STATES + j) * STATES + i] = A[(k * STATES + i) * STATES + j];
    inverse_sizes(m, microsteps_of(m), per_size);
    set_layers(m, per_size);
    double levels = fmax(1.0 + ceil(log2(longest * fastest(m, A, per_size) / m->packing[SHORTEST])), 8.0);
    if (levels > 40.0)
        levels = 40.0;
    if (levels > m->packing[MOST_LEVELS])
        return fails(m, "the parameter asks for shorter steps than this export has room for: export the drive with values nearer to it");
    *(int64_t *)of(m, "advance.t.levels") = *(int64_t *)of(m, "tabulate.t.levels") = (int64_t)levels;
    memset(sums.data, 0, sums.size * sizeof *sums.data);
    m->tabulate(of(m, "tabulate"), NULL);
    m->initial_friction(of(m, "initial_friction"), NULL);
    return 0;
}

/* The factor of the loads at the interface that hangs on the damping of a mode. */
static void set_damping(microvib *m, size_t mode, double ratio)
{
    double damping = 2.0 * ratio * sqrt(m->Lam[mode]);
    ((double *)m->D)[mode] = damping;
    for (size_t row = 0; row < 6 && m->weights.size > 0; row++) {
        double *weights = m->weights.data + row * m->channel_count;
        if (weights[CHANNEL_T_D] != 1.0) /* not the drive axis */
            weights[m->channel_count - m->modes + mode] = -m->by_hub.data[row * (m->modes + COMPONENTS) + mode] * damping;
    }
}

/* Microsteps per full step: the same profile in other steps. */
static void set_microsteps_per_step(microvib *m, double before, double after)
{
    size_t n = m->legs.size / 3;
    m->command[TURN] *= after / before;
    m->command[PER_RATE] *= after / before;
    for (size_t k = n; k < 3 * n; k++)
        m->legs.data[k] *= after / before;
}

int microvib_set_parameter(microvib *m, size_t which, double value)
{
    char said[200];
    m->why[0] = 0;
    if (which >= m->parameters)
        return fails(m, "there is no such parameter");
    const int64_t *place = m->parameter_places + 3 * which;
    double *now = m->parameter_values + 2 * which, lowest = now[1], before = now[0];
    const char *name = microvib_parameter_name(m, which);
    if (m->state[STARTED] != 0.0) {
        snprintf(said, sizeof said, "%s can be set before the first step alone", name);
        return fails(m, said);
    }
    if (!isfinite(value) || value < lowest || (place[2] && value == 0.0) ||
        (place[0] == MICROSTEPS_PER_STEP && (value != floor(value) || value > 65536.0))) {
        snprintf(said, sizeof said, "%s %g is not allowed; %s is expected", name, value,
                 place[0] == MICROSTEPS_PER_STEP ? "a whole number from 1 to 65536"
                 : place[0] == ARRAY_RATE        ? "a finite number"
                 : place[2]                      ? "a positive number"
                                                 : "0 or a positive number");
        return fails(m, said);
    }
    if (value == before)
        return 0;
    now[0] = value;
    m->instant_is_known = 0;
    switch (place[0]) {
    case FIELD:
        set_field(m, text(m->parameter_texts, 4 * which + 3), value);
        break;
    case DAMPING:
        set_damping(m, (size_t)place[1], value);
        break;
    case MICROSTEPS_PER_STEP:
        set_microsteps_per_step(m, before, value);
        break;
    default: /* the last leg's, behind a delay */
        m->legs.data[2 * (m->legs.size / 3) - 1] = value * m->command[PER_RATE];
        return 0;
    }
    return renew_tables(m);
}
