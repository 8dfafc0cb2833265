/* Steps and records, and what acts from outside. */

#include "instance.h"

enum { OK, LOST_SYNCHRONISM, STEP_TOO_SMALL, NOT_FINITE };

static int said(microvib *m, int64_t status)
{
    char whole[200];
    const char *what = "the solution is not finite";
    if (status == LOST_SYNCHRONISM)
        what = "loss of synchronism: the rotor is half an electrical period away from its commanded angle";
    if (status == STEP_TOO_SMALL)
        what = "the step became too small";
    snprintf(whole, sizeof whole, "simulation stopped at t = %.6g s: %s", m->clock[NOW], what);
    return fails(m, whole);
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
    char whole[160];
    snprintf(whole, sizeof whole, "the time %.17g s is not after the present one, %.17g s", stop, m->clock[NOW]);
    return fails(m, whole);
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

/* ---- What acts from outside ---- */

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
