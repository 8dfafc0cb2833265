/* Beginning and end of a drive, and its state (microvib.h says what each function does). */

#include "instance.h"

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

#define MAGIC INT64_C(0x004547414d49564d) /* "MVIMAGE" */
#define VERSION 1

/* ---- Beginning and end ---- */

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
    return h ? head_bytes() + 8 * (size_t)(h[H_WORDS] + 2 * (h[H_CHANGED_END] - h[H_CHANGED])) + 63 : 0;
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
    m->counters = of(m, "advance.x.counters");
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
    m->profile = array_of(m, "command.profile");
    m->turn = array_of(m, "command.references");
    m->command = of(m, "command.numbers");
    m->weights = array_of(m, "outputs.weights");
    m->places = of(m, "outputs.places");
    m->outputs = find(m, "outputs.places")->size / 2;
    m->texts = of(m, "outputs.texts");
    m->channel_texts = of(m, "channels.texts");
    m->parameters = find(m, "parameters.values")->size / VALUES;
    m->parameter_texts = of(m, "parameters.texts");
    m->parameter_places = of(m, "parameters.places");
    m->parameter_values = of(m, "parameters.values");
    m->packing = of(m, "parameters.packing");
}

/* A digest of an image as it is stored (FNV-1a by words), by which states know their drive. */
static uint64_t digest(const int64_t *words, int64_t count)
{
    uint64_t found = UINT64_C(14695981039346656037);
    for (int64_t k = 0; k < count; k++)
        found = (found ^ (uint64_t)words[k]) * UINT64_C(1099511628211);
    return found;
}

microvib *microvib_open(const void *image, size_t bytes, void *memory, char *why, size_t room)
{
    const int64_t *h = checked(image, &bytes);
    if (!h || !memory) {
        if (room && !h)
            snprintf(why, room, "the image is none of microvib's, cut off, or of another version than %d", VERSION);
        else if (room)
            snprintf(why, room, "there is no memory for a drive; it takes as many bytes as microvib_memory says");
        return NULL;
    }
    microvib *m = (microvib *)(((uintptr_t)memory + 63) / 64 * 64);
    memset(m, 0, sizeof *m);
    int64_t *base = m->image = (int64_t *)((char *)m + head_bytes());
    int64_t changes = h[H_CHANGED_END] - h[H_CHANGED];
    m->kept = base + h[H_WORDS];
    m->begun = m->kept + changes;
    memset(m->kept, 0, 8 * (size_t)changes);
    memcpy(m->begun, h + h[H_CHANGED], 8 * (size_t)changes);
    memcpy(base, h, 8 * (size_t)h[H_STORED]);
    memset(base + h[H_STORED], 0, 8 * (size_t)(h[H_WORDS] - h[H_STORED]));
    for (int64_t k = 0; k < h[H_ADDRESSES]; k++)
        base[h[h[H_LIST] + k]] += address(base);
    m->identity = digest(h, h[H_STORED]);
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

/* ---- State ----

   Words: the drive's digest, whether steps are independent, the parameters, what time changes, and the
   state at the last microstep where that is kept. */

enum { S_IDENTITY, S_INDEPENDENT, S_PARAMETERS };

static size_t state_head(const microvib *m)
{
    return 8 * (S_PARAMETERS + m->parameters);
}

size_t microvib_state_bytes(const microvib *m)
{
    size_t bytes;
    changed(m, &bytes);
    return state_head(m) + 2 * bytes;
}

void microvib_get_state(const microvib *m, void *state)
{
    size_t bytes;
    const int64_t *from = changed(m, &bytes);
    int64_t independent = m->independent;
    char *to = state;
    memcpy(to + 8 * S_IDENTITY, &m->identity, 8);
    memcpy(to + 8 * S_INDEPENDENT, &independent, 8);
    for (size_t k = 0; k < m->parameters; k++)
        memcpy(to + 8 * (S_PARAMETERS + k), m->parameter_values + VALUES * k + VALUE, 8);
    to += state_head(m);
    memcpy(to, from, bytes);
    memcpy(to + bytes, m->kept, bytes);
}

/* Whether parameters differ from doubles one after the other. */
static int differ_from(const microvib *m, const char *values)
{
    for (size_t k = 0; k < m->parameters; k++)
        if (memcmp(values + 8 * k, m->parameter_values + VALUES * k + VALUE, 8) != 0)
            return 1;
    return 0;
}

int microvib_set_state(microvib *m, const void *state)
{
    size_t bytes;
    int64_t *to = changed(m, &bytes), independent;
    uint64_t identity;
    const char *from = state;
    m->why[0] = 0;
    memcpy(&identity, from + 8 * S_IDENTITY, 8);
    memcpy(&independent, from + 8 * S_INDEPENDENT, 8);
    if (identity != m->identity)
        return fails(m, "the state is none of this drive's");
    if (differ_from(m, from + 8 * S_PARAMETERS)) {
        memcpy(to, m->begun, bytes); /* the linear part is that at rest */
        if (set_all_parameters(m, from + 8 * S_PARAMETERS))
            return 1;
    }
    m->independent = independent != 0;
    from += state_head(m);
    memcpy(to, from, bytes);
    memcpy(m->kept, from + bytes, bytes);
    m->instant_is_known = 0;
    *m->first = m->state[FIRST];
    *m->width = m->state[WIDTH] > 0.0 ? m->state[WIDTH] : 1.0;
    take_noise(m);
    return 0;
}
