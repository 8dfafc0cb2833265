/* Command: when microsteps come, and what the references are after each. */

#include "instance.h"

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

size_t microsteps_due(microvib *m, double *stop)
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

/* ---- Commands from outside ---- */

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
    m->why[0] = 0;
    if (!isfinite(rate))
        return fails(m, "the rate is not a finite number");
    if (fabs(per_second) > m->command[MOST_PER_SECOND]) {
        snprintf(m->why, sizeof m->why, "the rate of %.6g rad/s asks for %.3g microsteps per second; at most %.7g are followed", rate,
                 fabs(per_second), m->command[MOST_PER_SECOND]);
        return 1;
    }
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
    m->why[0] = 0;
    if (m->state[COMMAND] != BY_NUMBER)
        m->state[TAKEN] = (double)microvib_microsteps(m);
    m->state[COMMAND] = BY_NUMBER;
    m->state[KEPT] = 0.0;
    m->state[COUNT] = (double)count;
    m->state[SINCE] = m->clock[NOW];
    return 0;
}
