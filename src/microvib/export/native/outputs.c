/* Outputs. */

#include "instance.h"

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
    case COUNTED:
        return (double)m->counters[index];
    default:
        return (double)microvib_microsteps(m);
    }
}
