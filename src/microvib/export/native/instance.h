/* One drive in memory, as the files of the wrapper share it: microvib.c (beginning, end, state), command.c
   (microsteps), hub.c (the spacecraft's motion), steps.c, outputs.c and parameters.c. Everything that
   depends on the drive is in its image: numbers and arrays that the compiled functions take, found by
   name. docs/reference/export-interface.md describes the image. */

#ifndef MICROVIB_INSTANCE_H
#define MICROVIB_INSTANCE_H

#include "microvib.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- The compiled functions: words of the arguments, words of the result; 0 where all went well ---- */

typedef int32_t compiled(const void *arguments, void *result);

#define HIDDEN __attribute__((visibility("hidden")))

/* ---- Format of an image ---- */

#define NAME_BYTES 48

enum { H_MAGIC, H_VERSION, H_STORED, H_WORDS, H_ENTRIES, H_DIRECTORY, H_ADDRESSES, H_LIST, H_CHANGED, H_CHANGED_END, HEADER = 16 };
enum { NUMBER, ARRAY };

struct entry {
    char name[NAME_BYTES];
    int64_t kind, word, place, size; /* of an array: its record, and its data */
};

/* Kinds of outputs, and entries of clock and counters: as microvib.export.native.drive and
   microvib.solve.kernel have them. */
enum { INSTANT, MEAN, LOAD, LOAD_MEAN, ENERGY, COMMANDED, COUNTED };
enum { NOW = 0, WEIGHT = 8 };
enum { RATE_M = 5, RATE_L = 7, MODES = 8 }; /* in the state y */
enum { CHANNEL_T_D = 17 };

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
enum { TURN, CURRENT, RAMP, ON_TIME, PER_RATE, MOST_PER_SECOND, COMMAND_NUMBERS }; /* command.numbers */
enum { KNOT_RATE, OUTPUT_INERTIA, ROTOR_INERTIA, AXIS, SIX_KNOWN, COMPONENTS = 6 }; /* hub.numbers */
enum { VALUE, LOWEST, HIGHEST, EXPORTED, VALUES };                                  /* parameters.values */
enum { KIND, INDEX, POSITIVE, PLACES };                                             /* parameters.places */

struct array {
    int64_t *record; /* data, dimensions, place of these, nothing, lengths; NULL of none */
    double *data;
    size_t size;
};

struct microvib {
    int64_t *image;     /* relocated */
    uint64_t identity;  /* of the image as it was stored */
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
    const int64_t *counters;
    struct array rows, due, references, noise[2], knots, legs, profile, turn, weights, by_hub;
    double *command;
    const double *hub_numbers, *participation, *residual, *H, *Lam, *inv_h;
    double *D;
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
    int64_t *kept;  /* memory for a state */
    int64_t *begun; /* what time changes, as it was at first */
};

/* ---- Sentences and places ---- */

static inline int fails(microvib *m, const char *text)
{
    snprintf(m->why, sizeof m->why, "%s", text);
    return 1;
}

static inline const struct entry *find(const microvib *m, const char *name)
{
    for (size_t k = 0; k < m->entry_count; k++)
        if (strcmp(m->entries[k].name, name) == 0)
            return &m->entries[k];
    return NULL;
}

/* The word of a number, or the data of an array. */
static inline void *of(const microvib *m, const char *name)
{
    const struct entry *e = find(m, name);
    return e ? (void *)(m->image + (e->kind == NUMBER ? e->word : e->place)) : NULL;
}

static inline struct array array_of(const microvib *m, const char *name)
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

static inline int64_t address(const void *place)
{
    return (int64_t)(intptr_t)place;
}

/* Lengths of an array in its record. */
static inline int64_t *shape(struct array a)
{
    return a.record + 4;
}

static inline void point_to(struct array a, const void *data, size_t length)
{
    a.record[0] = address(data);
    shape(a)[0] = (int64_t)length;
}

/* The text of a number, of texts one after the other. */
static inline const char *text(const char *all, size_t which)
{
    while (which--)
        all += strlen(all) + 1;
    return all;
}

/* What time changes. */
static inline int64_t *changed(const microvib *m, size_t *bytes)
{
    *bytes = 8 * (size_t)(m->image[H_CHANGED_END] - m->image[H_CHANGED]);
    return m->image + m->image[H_CHANGED];
}

/* ---- command.c ---- */

/* Microsteps from now to `*stop`, which is put back where there are too many; how many. */
HIDDEN size_t microsteps_due(microvib *m, double *stop);

/* ---- hub.c ---- */

/* What the acceleration does to a mode, and its component about the drive axis. */
HIDDEN double hub_force(const microvib *m, size_t mode);
HIDDEN double about_axis(const microvib *m, const double acceleration[COMPONENTS]);
/* Torque against the output by the spacecraft's motion, less that of others on the shaft, now. */
HIDDEN double hub_torque(const microvib *m);
/* Fill the knots of that torque from now on, and put `*stop` back to where they end. */
HIDDEN void fill_knots(microvib *m, double *stop);
/* Move what the spacecraft's motion has made of the modes to the time `stop`. */
HIDDEN void move_hub(microvib *m, double stop);
HIDDEN void begin_hub_means(microvib *m);
/* The integrals of what the spacecraft's motion made, over `span`, as means. */
HIDDEN void end_hub_means(microvib *m, double span);
/* Give the equations their torque noise, or the knots that have it and the spacecraft's motion. */
HIDDEN void take_noise(microvib *m);

/* ---- parameters.c ---- */

/* Set all parameters to doubles one after the other; 0, or the sentence on what went wrong in `why`. */
HIDDEN int set_all_parameters(microvib *m, const void *values);

#endif
