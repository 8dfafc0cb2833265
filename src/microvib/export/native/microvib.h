/* A solar array drive of microvib: its equations of motion as compiled code, driven from C.

   An instance is one drive at one time. It lives in memory that the caller gives or that
   microvib_new allocates; instances share nothing, so that each may run in a thread of its own.
   Units are SI. Signs are those of microvib (docs/signs.md): the disturbance torque T_d acts on the
   spacecraft, about the drive axis. */

#ifndef MICROVIB_H
#define MICROVIB_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32) && defined(MICROVIB_BUILDS_LIBRARY)
#define MICROVIB_API __declspec(dllexport)
#elif defined(MICROVIB_BUILDS_LIBRARY)
#define MICROVIB_API __attribute__((visibility("default")))
#else
#define MICROVIB_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct microvib microvib;

/* ---- Beginning and end ----
   Functions that can fail give NULL or a status that is not 0; the sentence on it is then in `why`
   (of `room` bytes; NULL and 0 are allowed) or in microvib_error. */

/* An instance of the drive that this library was made of, at rest at time 0. */
MICROVIB_API microvib *microvib_new(char *why, size_t room);
MICROVIB_API void microvib_free(microvib *drive);

/* The same without allocation: bytes of memory that an image needs (0: it is none), and an instance
   in such memory, which may begin anywhere. `image` NULL is the one in this library. */
MICROVIB_API size_t microvib_memory(const void *image, size_t bytes);
MICROVIB_API microvib *microvib_open(const void *image, size_t bytes, void *memory, char *why, size_t room);

/* What went wrong last; empty where nothing did. */
MICROVIB_API const char *microvib_error(const microvib *drive);

/* ---- Parameters: only before the first step. What is not among them is fixed at export. A value that is
   refused leaves the drive as it was. ---- */

MICROVIB_API size_t microvib_parameters(const microvib *drive);
MICROVIB_API const char *microvib_parameter_name(const microvib *drive, size_t which);
MICROVIB_API double microvib_parameter(const microvib *drive, size_t which);
MICROVIB_API int microvib_set_parameter(microvib *drive, size_t which, double value);

/* ---- Motion ---- */

MICROVIB_API double microvib_time(const microvib *drive); /* [s] */

/* Advance to the time `stop` [s], with all microsteps that are due. Means (`T_d_mean` and others)
   are then those from the last such call's end on. */
MICROVIB_API int microvib_do_step(microvib *drive, double stop);

/* Before the first step: internal steps that do not end where communication steps do, so that the motion
   does not hang on them as long as no input changes. What is between the last microstep and the time of
   the call is then computed again in the next step: asked for more often than microsteps come, this takes
   several times as long. */
MICROVIB_API int microvib_set_independent(microvib *drive, int on);

/* Outputs by number, in the order of their names; NULL and NaN for a number that is none. */
MICROVIB_API size_t microvib_outputs(const microvib *drive);
MICROVIB_API const char *microvib_output_name(const microvib *drive, size_t which);
MICROVIB_API const char *microvib_output_unit(const microvib *drive, size_t which);
MICROVIB_API const char *microvib_output_meaning(const microvib *drive, size_t which);
MICROVIB_API double microvib_output(microvib *drive, size_t which);
/* Number of the output of a name; -1 where there is none. */
MICROVIB_API int microvib_find_output(const microvib *drive, const char *name);

/* ---- Command: the scenario's rate profile, until one of these is called ---- */

/* From now on the array's commanded rate is `rate` [rad/s], by the step clock (tracking.clock_ratio); at most
   five million microsteps per second are followed. */
MICROVIB_API int microvib_set_rate(microvib *drive, double rate);
/* From now on microsteps come only by this call: the rotor is commanded to `count` microsteps from
   its first position, at once. */
MICROVIB_API int microvib_set_microsteps(microvib *drive, int64_t count);
/* Microsteps that the rotor is commanded to at this time. */
MICROVIB_API int64_t microvib_microsteps(const microvib *drive);

/* ---- The spacecraft's motion ---- */

/* Angular acceleration [rad/s^2] of the spacecraft about the drive axis, from now on. */
MICROVIB_API int microvib_set_hub_acceleration(microvib *drive, double acceleration);

/* The same of the interface in all its components, in the axes of the array: 0 to 2 along x, y, z [m/s^2],
   3 to 5 about them [rad/s^2]. Components beside the drive axis need an array whose mass properties and
   modes are known in all six. */
MICROVIB_API int microvib_set_interface_acceleration(microvib *drive, int component, double acceleration);

/* Torque [N m] that something outside of this drive and its array puts on the output shaft, from now on. */
MICROVIB_API int microvib_set_shaft_torque(microvib *drive, double torque);

/* ---- Records ----
   Channels as means over intervals of `width` [s] from `first` [s] on: what `microvib run` filters
   to its samples. A row has microvib_columns numbers, channels in the order of
   microvib_channel_name; the last may be padding, whose name is empty. */

MICROVIB_API size_t microvib_columns(const microvib *drive);
MICROVIB_API const char *microvib_channel_name(const microvib *drive, size_t column);
MICROVIB_API int microvib_begin_record(microvib *drive, double first, double width);
/* Advance by `count` intervals and fill as many rows. */
MICROVIB_API int microvib_record(microvib *drive, size_t count, double *rows);

/* ---- State: parameters and all that time changes, as bytes that are valid for this drive in this version.
   They may be put into any of its instances; those of another drive are refused. ---- */

MICROVIB_API size_t microvib_state_bytes(const microvib *drive);
MICROVIB_API void microvib_get_state(const microvib *drive, void *state);
MICROVIB_API int microvib_set_state(microvib *drive, const void *state);

#ifdef __cplusplus
}
#endif

#endif
