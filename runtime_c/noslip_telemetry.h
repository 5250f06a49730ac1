/*
 * noslip_telemetry.h - what a vehicle did at each tick, as frames of bytes for a serial line, a bus or a file.
 *
 *     static uint8_t memory[2048];
 *     noslip_telemetry telemetry;
 *     status = noslip_telemetry_init(&telemetry, memory, sizeof memory);
 *
 * At each tick, after the one of the follower (generated NAME_telemetry.h):
 *
 *     (void)labmate_follower_record_f(&follower, counts, missed, status, command, &record);
 *     (void)noslip_telemetry_record_f(&telemetry, &record);
 *
 * and whenever the line takes bytes, from the same task or one other, such as an interrupt of the same processor:
 *
 *     (void)noslip_telemetry_read(&telemetry, bytes, sizeof bytes, &count);
 *
 * A frame is a byte with its kind, its contents and a CRC-32 of both, encoded by COBS (Cheshire and Baker 1999): it has no byte 0,
 * and a 0 ends it. A reader that joins later, or after a damaged frame, continues behind the next 0. Numbers are little-endian. A
 * frame for which the ring has no room is left out as a whole and counted; the ticks in the records show where. `noslip log` reads
 * the frames, `noslip replay` repeats them.
 *
 * Functions and types of a record exist for double and, with the suffix _f, for float; those of frames have no scalar.
 */
#ifndef NOSLIP_TELEMETRY_H
#define NOSLIP_TELEMETRY_H

#include "noslip_image.h"
#include "noslip_odometry.h"
#include "noslip_watchdog.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Kinds of frames. The number of bytes tells whether reals are float or double. */
typedef enum noslip_frame_kind {
    NOSLIP_FRAME_ROBOT = 1,   /* the name of the robot, as text */
    NOSLIP_FRAME_CONFIG = 2,  /* the image of the config, see noslip_image.h */
    NOSLIP_FRAME_UPDATE = 3,  /* the image of parameters, gains and limits in use, see NAME_follower_update */
    NOSLIP_FRAME_RECORD = 4,  /* a tick, noslip_record */
    NOSLIP_FRAME_CORRECT = 5, /* a correction of the pose before the next tick: x, y, heading, mode */
    NOSLIP_FRAME_RESET = 6,   /* NAME_follower_reset before the next tick */
    NOSLIP_FRAME_OWN = 64,    /* from here on: for the user; `noslip log` counts them */
    NOSLIP_FRAME_KIND_AS_INT = -0x7fffffff
} noslip_frame_kind;

#define NOSLIP_RECORD_SIZE(real) (28u + 19u * (uint32_t)(real)) /* bytes of a record in a frame; `real`: of a real */

/* Frames on their way: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_telemetry {
    uint8_t *ring;
    uint32_t mask;             /* size of the ring - 1 */
    volatile uint32_t written; /* bytes of complete frames so far, modulo 2^32 */
    volatile uint32_t taken;   /* bytes that have been read, modulo 2^32 */
    uint32_t tick;             /* number of the next tick, missed ones counted */
    uint32_t dropped;          /* frames for which there was no room */
    int ready;                 /* set by init */
} noslip_telemetry;

/* A frame that is being written. Internal. */
typedef struct noslip_frame {
    noslip_telemetry *to;
    uint32_t at;   /* place of the next byte */
    uint32_t code; /* place of the code of the current block */
    uint32_t run;  /* bytes of this block so far, its code included */
    uint32_t crc;
} noslip_frame;

/* Initializes an empty ring in the memory of the caller. Returns NOSLIP_BAD_PARAMETER unless `size` is a power of two from 256 to 2^30. */
NOSLIP_NODISCARD int noslip_telemetry_init(noslip_telemetry *self, uint8_t *memory, uint32_t size);

/* Writes a frame with these contents. Returns NOSLIP_FULL if the ring has no room for it, NOSLIP_BAD_PARAMETER for a kind outside 1 to 255. */
int noslip_telemetry_send(noslip_telemetry *self, int kind, const uint8_t *bytes, uint32_t count);

/* Takes up to `most` bytes out of the ring; `count` receives their number. */
int noslip_telemetry_read(noslip_telemetry *self, uint8_t *bytes, uint32_t most, uint32_t *count);

/* Begins a frame with `count` bytes of contents, adds a byte or a number, ends it. Internal. */
int noslip_frame_begin(noslip_frame *self, noslip_telemetry *to, int kind, uint32_t count);
void noslip_frame_byte(noslip_frame *self, uint8_t byte);
void noslip_frame_word(noslip_frame *self, uint32_t word);
int noslip_frame_end(noslip_frame *self);

/* Adds a real to a frame. Internal. */
static inline void noslip_frame_real_f(noslip_frame *self, float x)
{
    noslip_bits_f v;
    v.value = x;
    noslip_frame_word(self, v.bits);
}

static inline void noslip_frame_real(noslip_frame *self, double x)
{
    noslip_bits v;
    v.value = x;
    noslip_frame_word(self, (uint32_t)(v.bits & 0xffffffffu));
    noslip_frame_word(self, (uint32_t)(v.bits >> 32));
}

/* -- double: generated from noslip_telemetry.inc by guarantees/headers.py ---------------------------------------------- */

/* One tick of a vehicle with two driven wheels, SI units. In a frame: its fields in this order. */
typedef struct noslip_record {
    uint32_t tick;                    /* number of the tick since init, missed ones counted: set by noslip_telemetry_record */
    uint32_t missed;                  /* ticks left out before this one */
    uint32_t counts[2];               /* counters of the encoders; not used where dt > 0 */
    int status;                       /* of the tick: NOSLIP_... */
    int watchdog;                     /* its state + 256 * its reason */
    int segment;                      /* of the path, from 0 */
    double dt;                        /* s: of a tick by angles; 0: by counts */
    double turned[2];                 /* rad: angles of the wheels in a tick by angles */
    noslip_pose pose;                 /* of the vehicle's point, from dead reckoning */
    double rate[2];                   /* rad/s: filtered rates of the wheels */
    double desired_speed;             /* m/s */
    double desired_speed_rate;        /* m/s^2 */
    double desired_distance[3];       /* m, m/s, m/s^2: desired distance from the path and its derivatives */
    double distance;                  /* m: of P_l from the path, positive to the left */
    double speed;                     /* m/s: forward */
    double torque[2];                 /* N m: of the law */
    double command[2];                /* to the drives */
} noslip_record;

/* Adds `count` reals to a frame. Internal. */
static inline void noslip_frame_reals(noslip_frame *self, const double *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        noslip_frame_real(self, values[i]);
    }
}

/* Numbers the record of a tick and writes it as a frame. Returns NOSLIP_NULL, NOSLIP_NOT_READY, or NOSLIP_FULL if the ring has no room
 * for it; the tick is counted all the same. */
static inline int noslip_telemetry_record(noslip_telemetry *self, noslip_record *record)
{
    noslip_frame frame;
    int status;
    if (self == NULL || record == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    record->tick = self->tick + record->missed;
    self->tick = record->tick + 1u;
    status = noslip_frame_begin(&frame, self, NOSLIP_FRAME_RECORD, NOSLIP_RECORD_SIZE(sizeof(double)));
    if (status < 0) {
        return status;
    }
    noslip_frame_word(&frame, record->tick);
    noslip_frame_word(&frame, record->missed);
    noslip_frame_word(&frame, record->counts[0]);
    noslip_frame_word(&frame, record->counts[1]);
    noslip_frame_word(&frame, (uint32_t)record->status);
    noslip_frame_word(&frame, (uint32_t)record->watchdog);
    noslip_frame_word(&frame, (uint32_t)record->segment);
    noslip_frame_real(&frame, record->dt);
    noslip_frame_reals(&frame, record->turned, 2);
    noslip_frame_real(&frame, record->pose.x);
    noslip_frame_real(&frame, record->pose.y);
    noslip_frame_real(&frame, record->pose.heading);
    noslip_frame_reals(&frame, record->rate, 2);
    noslip_frame_real(&frame, record->desired_speed);
    noslip_frame_real(&frame, record->desired_speed_rate);
    noslip_frame_reals(&frame, record->desired_distance, 3);
    noslip_frame_real(&frame, record->distance);
    noslip_frame_real(&frame, record->speed);
    noslip_frame_reals(&frame, record->torque, 2);
    noslip_frame_reals(&frame, record->command, 2);
    return noslip_frame_end(&frame);
}

/* Writes a frame that tells of a correction of the pose, NAME_follower_correct, before the next tick. Returns as noslip_telemetry_send. */
static inline int noslip_telemetry_correct(noslip_telemetry *self, const noslip_pose *truth,
                               noslip_correction mode)
{
    noslip_frame frame;
    int status;
    if (self == NULL || truth == NULL) {
        return NOSLIP_NULL;
    }
    status = noslip_frame_begin(&frame, self, NOSLIP_FRAME_CORRECT, 3u * (uint32_t)sizeof(double) + 4u);
    if (status < 0) {
        return status;
    }
    noslip_frame_real(&frame, truth->x);
    noslip_frame_real(&frame, truth->y);
    noslip_frame_real(&frame, truth->heading);
    noslip_frame_word(&frame, (uint32_t)mode);
    return noslip_frame_end(&frame);
}

/* -- float: generated from noslip_telemetry.inc by guarantees/headers.py ----------------------------------------------- */

/* One tick of a vehicle with two driven wheels, SI units. In a frame: its fields in this order. */
typedef struct noslip_record_f {
    uint32_t tick;                    /* number of the tick since init, missed ones counted: set by noslip_telemetry_record */
    uint32_t missed;                  /* ticks left out before this one */
    uint32_t counts[2];               /* counters of the encoders; not used where dt > 0 */
    int status;                       /* of the tick: NOSLIP_... */
    int watchdog;                     /* its state + 256 * its reason */
    int segment;                      /* of the path, from 0 */
    float dt;                         /* s: of a tick by angles; 0: by counts */
    float turned[2];                  /* rad: angles of the wheels in a tick by angles */
    noslip_pose_f pose;               /* of the vehicle's point, from dead reckoning */
    float rate[2];                    /* rad/s: filtered rates of the wheels */
    float desired_speed;              /* m/s */
    float desired_speed_rate;         /* m/s^2 */
    float desired_distance[3];        /* m, m/s, m/s^2: desired distance from the path and its derivatives */
    float distance;                   /* m: of P_l from the path, positive to the left */
    float speed;                      /* m/s: forward */
    float torque[2];                  /* N m: of the law */
    float command[2];                 /* to the drives */
} noslip_record_f;

/* Adds `count` reals to a frame. Internal. */
static inline void noslip_frame_reals_f(noslip_frame *self, const float *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        noslip_frame_real_f(self, values[i]);
    }
}

/* Numbers the record of a tick and writes it as a frame. Returns NOSLIP_NULL, NOSLIP_NOT_READY, or NOSLIP_FULL if the ring has no room
 * for it; the tick is counted all the same. */
static inline int noslip_telemetry_record_f(noslip_telemetry *self, noslip_record_f *record)
{
    noslip_frame frame;
    int status;
    if (self == NULL || record == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    record->tick = self->tick + record->missed;
    self->tick = record->tick + 1u;
    status = noslip_frame_begin(&frame, self, NOSLIP_FRAME_RECORD, NOSLIP_RECORD_SIZE(sizeof(float)));
    if (status < 0) {
        return status;
    }
    noslip_frame_word(&frame, record->tick);
    noslip_frame_word(&frame, record->missed);
    noslip_frame_word(&frame, record->counts[0]);
    noslip_frame_word(&frame, record->counts[1]);
    noslip_frame_word(&frame, (uint32_t)record->status);
    noslip_frame_word(&frame, (uint32_t)record->watchdog);
    noslip_frame_word(&frame, (uint32_t)record->segment);
    noslip_frame_real_f(&frame, record->dt);
    noslip_frame_reals_f(&frame, record->turned, 2);
    noslip_frame_real_f(&frame, record->pose.x);
    noslip_frame_real_f(&frame, record->pose.y);
    noslip_frame_real_f(&frame, record->pose.heading);
    noslip_frame_reals_f(&frame, record->rate, 2);
    noslip_frame_real_f(&frame, record->desired_speed);
    noslip_frame_real_f(&frame, record->desired_speed_rate);
    noslip_frame_reals_f(&frame, record->desired_distance, 3);
    noslip_frame_real_f(&frame, record->distance);
    noslip_frame_real_f(&frame, record->speed);
    noslip_frame_reals_f(&frame, record->torque, 2);
    noslip_frame_reals_f(&frame, record->command, 2);
    return noslip_frame_end(&frame);
}

/* Writes a frame that tells of a correction of the pose, NAME_follower_correct, before the next tick. Returns as noslip_telemetry_send. */
static inline int noslip_telemetry_correct_f(noslip_telemetry *self, const noslip_pose_f *truth,
                                   noslip_correction mode)
{
    noslip_frame frame;
    int status;
    if (self == NULL || truth == NULL) {
        return NOSLIP_NULL;
    }
    status = noslip_frame_begin(&frame, self, NOSLIP_FRAME_CORRECT, 3u * (uint32_t)sizeof(float) + 4u);
    if (status < 0) {
        return status;
    }
    noslip_frame_real_f(&frame, truth->x);
    noslip_frame_real_f(&frame, truth->y);
    noslip_frame_real_f(&frame, truth->heading);
    noslip_frame_word(&frame, (uint32_t)mode);
    return noslip_frame_end(&frame);
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#ifdef __cplusplus
}
#endif

#endif
