/* Parameters.

   What hangs on them is made anew, as solve/pack.py makes it: numbers of the drive wherever a call has
   them, the linear part and its tables, and the friction's modes at rest. */

#include "instance.h"

enum { FIELD, DAMPING, MICROSTEPS_PER_STEP, ARRAY_RATE }; /* kinds */
enum { /* parameters.packing */
    CURRENT_SIZE, INTEGRAL_SIZE, FULL_STEP, RATIO, ROTOR_RATE, OUTPUT_LEFT, MOST_LEVELS, SHORTEST, MICROSTEPS, EXPORTED_TURN,
    EXPORTED_PER_RATE
};
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
    return which < m->parameters ? m->parameter_values[VALUES * which + VALUE] : NAN;
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
        if (m->parameter_places[PLACES * k + KIND] == MICROSTEPS_PER_STEP)
            found = m->parameter_values[VALUES * k + VALUE];
    return found;
}

/* Leave of windings that are switched the decay of their own current alone, as solve/pack.py does. */
static void leave_windings_apart(const microvib *m, double *A)
{
    static const int windings[] = {IA, IB, XA, XB};
    double decay = -field(m, "R") / field(m, "L");
    for (int k = 0; k < PATTERNS; k++) {
        double *pattern = A + k * STATES * STATES;
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < STATES; j++)
                pattern[windings[i] * STATES + j] = pattern[j * STATES + windings[i]] = 0.0;
        pattern[IA * STATES + IA] = pattern[IB * STATES + IB] = decay;
    }
}

/* Make the tables of the linear part and the friction's modes at rest anew. */
static int renew_tables(microvib *m)
{
    double *A = array_of(m, "advance.t.A").data, *columns = array_of(m, "advance.t.columns").data;
    double per_size[STATES], longest = *(double *)of(m, "advance.t.longest");
    struct array sums = array_of(m, "advance.t.sums");
    m->linear_part(of(m, "linear_part"), NULL);
    if (*(int64_t *)of(m, "advance.p.windings") > 0)
        leave_windings_apart(m, A);
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
    m->D[mode] = damping;
    for (size_t row = 0; row < 6 && m->weights.size > 0; row++) {
        double *weights = m->weights.data + row * m->channel_count;
        if (weights[CHANNEL_T_D] != 1.0) /* not the drive axis */
            weights[m->channel_count - m->modes + mode] = -m->by_hub.data[row * (m->modes + COMPONENTS) + mode] * damping;
    }
}

/* The command as exported, in the microsteps and at the rate of the parameters. */
static int renew_command(microvib *m)
{
    size_t n = m->legs.size / 3;
    double factor = microsteps_of(m) / m->packing[MICROSTEPS], largest = 0.0;
    m->command[TURN] = m->packing[EXPORTED_TURN] * factor;
    m->command[PER_RATE] = m->packing[EXPORTED_PER_RATE] * factor;
    for (size_t k = n; k < 3 * n; k++)
        m->legs.data[k] = m->profile.data[k] * factor;
    for (size_t k = 0; k < m->parameters; k++) {
        const double *values = m->parameter_values + VALUES * k;
        if (m->parameter_places[PLACES * k + KIND] == ARRAY_RATE && values[VALUE] != values[EXPORTED])
            m->legs.data[2 * n - 1] = values[VALUE] * m->command[PER_RATE]; /* the last leg's, behind a delay */
    }
    for (size_t k = n; k < 2 * n; k++)
        largest = fmax(largest, fabs(m->legs.data[k]));
    if (largest <= m->command[MOST_PER_SECOND])
        return 0;
    snprintf(m->why, sizeof m->why, "the command asks for %.3g microsteps per second; at most %.7g are followed", largest,
             m->command[MOST_PER_SECOND]);
    return 1;
}

/* Give a parameter a value, but for the tables. */
static int give_value(microvib *m, size_t which, double value)
{
    const int64_t *place = m->parameter_places + PLACES * which;
    m->parameter_values[VALUES * which + VALUE] = value;
    m->instant_is_known = 0;
    if (place[KIND] == FIELD)
        set_field(m, text(m->parameter_texts, 4 * which + 3), value);
    else if (place[KIND] == DAMPING)
        set_damping(m, (size_t)place[INDEX], value);
    else
        return renew_command(m);
    return 0;
}

/* The sentence on a value that is not allowed, in `said`; 0 where it is. */
static int is_refused(const microvib *m, size_t which, double value, char *said, size_t room)
{
    const int64_t *place = m->parameter_places + PLACES * which;
    const double *values = m->parameter_values + VALUES * which;
    int whole = place[KIND] == MICROSTEPS_PER_STEP, positive = place[POSITIVE] != 0;
    double lowest = values[LOWEST], highest = values[HIGHEST];
    char expected[100];
    if (isfinite(value) && value >= lowest && value <= highest && !(positive && value == 0.0) && !(whole && value != floor(value)))
        return 0;
    if (isfinite(highest))
        snprintf(expected, sizeof expected, "a %snumber from %g to %g", whole ? "whole " : "", lowest, highest);
    else if (isfinite(lowest))
        snprintf(expected, sizeof expected, "%s", positive ? "a positive number" : "0 or a positive number");
    else
        snprintf(expected, sizeof expected, "a finite number");
    snprintf(said, room, "%s %g is not allowed; %s is expected", microvib_parameter_name(m, which), value, expected);
    return 1;
}

int microvib_set_parameter(microvib *m, size_t which, double value)
{
    char said[256];
    m->why[0] = 0;
    if (which >= m->parameters)
        return fails(m, "there is no such parameter");
    if (m->state[STARTED] != 0.0) {
        snprintf(said, sizeof said, "%s can be set before the first step alone", microvib_parameter_name(m, which));
        return fails(m, said);
    }
    if (is_refused(m, which, value, said, sizeof said))
        return fails(m, said);
    double before = microvib_parameter(m, which);
    if (value == before)
        return 0;
    if (!give_value(m, which, value) && !renew_tables(m))
        return 0;
    snprintf(said, sizeof said, "%s", m->why); /* the drive stays as it was */
    give_value(m, which, before);
    renew_tables(m);
    return fails(m, said);
}

int set_all_parameters(microvib *m, const void *values)
{
    for (size_t k = 0; k < m->parameters; k++) {
        double value;
        memcpy(&value, (const char *)values + 8 * k, sizeof value);
        if (value != microvib_parameter(m, k) && give_value(m, k, value))
            return 1;
    }
    return renew_tables(m);
}
