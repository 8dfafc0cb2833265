/* The spacecraft's motion.

   Where the interface is accelerated by a (six components, axes of the array), everything on it feels
   -M a. The modes are linear: what they do by a alone, with the output held, adds to what they do by the
   output. It is known in closed form, since a is constant within a step; its torque on the output, and
   that of the rigid inertias, is handed to the equations in place of torque noise, which is just such a
   given torque, together with what others put on the output shaft. The rotor's own inertia acts at the
   output, through the ratio. */

#include "instance.h"

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

double hub_force(const microvib *m, size_t k)
{
    double total = 0.0;
    for (size_t j = 0; j < COMPONENTS; j++)
        total -= m->participation[j * m->modes + k] * m->acceleration[j];
    return total;
}

double about_axis(const microvib *m, const double acceleration[COMPONENTS])
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
double hub_torque(const microvib *m)
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
void fill_knots(microvib *m, double *stop)
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
void move_hub(microvib *m, double stop)
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

/* The integrals of what the spacecraft's motion made, over `span`, as means. */
void end_hub_means(microvib *m, double span)
{
    m->state[GIVEN_MEAN] /= span;
    for (size_t k = 0; k < m->modes; k++)
        m->integrals[k] /= span;
}

void begin_hub_means(microvib *m)
{
    m->state[GIVEN_MEAN] = 0.0;
    memset(m->integrals, 0, m->modes * sizeof *m->integrals);
    memcpy(m->last, m->acceleration, COMPONENTS * sizeof *m->last);
}

/* Give the equations their torque noise, or the knots that have it and the spacecraft's motion. */
void take_noise(microvib *m)
{
    int acts = m->state[GIVEN] != 0.0;
    struct array from = acts ? m->knots : m->own_noise;
    double rate = acts ? m->hub_numbers[KNOT_RATE] : m->own_noise_rate;
    for (int k = 0; k < 2; k++) {
        point_to(m->noise[k], from.data, from.size);
        *m->noise_rate[k] = rate;
    }
}
