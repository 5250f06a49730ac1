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

#define NOSLIP_MODULE "noslip_telemetry.inc"
#include "noslip_scalars.inc"

#ifdef __cplusplus
}
#endif

#endif
