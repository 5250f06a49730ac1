/* noslip_telemetry.c - frames of bytes in a ring, see noslip_telemetry.h. */
#include "noslip_telemetry.h"

#define LEAST 256u      /* bytes of a ring */
#define MOST 0x40000000u
#define FULL_BLOCK 255u /* code of a block without a 0 behind it */

int noslip_telemetry_init(noslip_telemetry *self, uint8_t *memory, uint32_t size)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (memory == NULL) {
        return NOSLIP_NULL;
    }
    if (size < LEAST || size > MOST || (size & (size - 1u)) != 0u) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->ring = memory;
    self->mask = size - 1u;
    self->written = 0;
    self->taken = 0;
    self->tick = 0;
    self->dropped = 0;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Returns the most bytes that a frame takes with its kind, CRC, codes and end; 0 if more than any ring has. */
static uint32_t most_bytes(uint32_t count)
{
    const uint32_t inside = count + 5u;
    return count > MOST ? 0 : inside + inside / (FULL_BLOCK - 1u) + 2u;
}

/* Writes the code of the current block and begins another one. */
static void end_block(noslip_frame *self)
{
    self->to->ring[self->code & self->to->mask] = (uint8_t)self->run;
    self->code = self->at;
    self->at++;
    self->run = 1;
}

static void encode(noslip_frame *self, uint8_t byte)
{
    if (byte == 0u) {
        end_block(self);
        return;
    }
    self->to->ring[self->at & self->to->mask] = byte;
    self->at++;
    self->run++;
    if (self->run == FULL_BLOCK) {
        end_block(self);
    }
}

int noslip_frame_begin(noslip_frame *self, noslip_telemetry *to, int kind, uint32_t count)
{
    const uint32_t needed = most_bytes(count);
    if (self == NULL || to == NULL) {
        return NOSLIP_NULL;
    }
    if (to->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (kind < 1 || kind > 255) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (needed == 0u || needed > to->mask + 1u - (to->written - to->taken)) {
        to->dropped++;
        return NOSLIP_FULL;
    }
    self->to = to;
    self->code = to->written;
    self->at = self->code + 1u;
    self->run = 1;
    self->crc = 0;
    noslip_frame_byte(self, (uint8_t)kind);
    return NOSLIP_OK;
}

void noslip_frame_byte(noslip_frame *self, uint8_t byte)
{
    self->crc = noslip_crc32(self->crc, &byte, 1);
    encode(self, byte);
}

void noslip_frame_word(noslip_frame *self, uint32_t word)
{
    noslip_frame_byte(self, (uint8_t)(word & 255u));
    noslip_frame_byte(self, (uint8_t)((word >> 8) & 255u));
    noslip_frame_byte(self, (uint8_t)((word >> 16) & 255u));
    noslip_frame_byte(self, (uint8_t)(word >> 24));
}

int noslip_frame_end(noslip_frame *self)
{
    noslip_telemetry *const to = self->to;
    noslip_frame_word(self, self->crc); /* its own CRC is not used */
    to->ring[self->code & to->mask] = (uint8_t)self->run;
    to->ring[self->at & to->mask] = 0;
    to->written = self->at + 1u; /* last: from now on the frame can be read */
    return NOSLIP_OK;
}

int noslip_telemetry_send(noslip_telemetry *self, int kind, const uint8_t *bytes, uint32_t count)
{
    noslip_frame frame;
    uint32_t i;
    int status;
    if (bytes == NULL && count > 0u) {
        return NOSLIP_NULL;
    }
    status = noslip_frame_begin(&frame, self, kind, count);
    if (status < 0) {
        return status;
    }
    for (i = 0; i < count; i++) {
        noslip_frame_byte(&frame, bytes[i]);
    }
    return noslip_frame_end(&frame);
}

int noslip_telemetry_read(noslip_telemetry *self, uint8_t *bytes, uint32_t most, uint32_t *count)
{
    uint32_t there, from, i;
    if (self == NULL || bytes == NULL || count == NULL) {
        return NOSLIP_NULL;
    }
    *count = 0;
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    from = self->taken;
    there = self->written - from;
    there = there < most ? there : most;
    for (i = 0; i < there; i++) {
        bytes[i] = self->ring[(from + i) & self->mask];
    }
    self->taken = from + there; /* last: from now on its place is free */
    *count = there;
    return NOSLIP_OK;
}
