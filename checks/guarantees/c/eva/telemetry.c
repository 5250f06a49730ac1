/*
 * telemetry.c - frames and images for EVA, in the scalar REAL with SUFFIX: whatever their contents, nothing outside the ring, the
 * image, the config and the segments is read or written.
 *
 * A ring keeps the properties that init establishes, so that the results hold for any sequence of calls, also if another task reads
 * between any two of them.
 */
#include "eva.h"
#include HEADER

#define OF_FOLLOWER(name) OF(GLUE(GLUE(ROBOT, _follower), name))
#define RING 256
#define SEGMENTS 2
#define IMAGE 1024

static uint8_t ring[RING];

void check_ring_is_sound(const noslip_telemetry *self)
{
    /*@ assert self->ring == &ring[0] && self->mask == RING - 1 && self->ready == NOSLIP_READY; */
}

void check_ring(void)
{
    noslip_telemetry self;
    OF(noslip_record) record;
    OF(noslip_pose) truth;
    uint8_t bytes[16];
    uint32_t count;
    int status;
    ANY(self);
    if (noslip_telemetry_init(&self, ring, (uint32_t)any_int) < 0) {
        REACHED(ring_refused);
        /*@ assert self.ready == 0; */
    }
    status = noslip_telemetry_init(&self, ring, RING);
    /*@ assert status == NOSLIP_OK; */
    check_ring_is_sound(&self);
    ANY(ring);
    self.written = (uint32_t)any_int;
    self.taken = (uint32_t)any_int;
    ANY(record);
    if (OF(noslip_telemetry_record)(&self, &record) < 0) {
        REACHED(record_refused);
    } else {
        REACHED(record_good);
    }
    check_ring_is_sound(&self);
    ANY(truth);
    ANY(bytes);
    if (OF(noslip_telemetry_correct)(&self, &truth, any_int) >= 0) {
        REACHED(correct_good);
    }
    if (noslip_telemetry_send(&self, any_int, bytes, sizeof bytes) >= 0) {
        REACHED(send_good);
    }
    check_ring_is_sound(&self);
    if (noslip_telemetry_read(&self, bytes, sizeof bytes, &count) >= 0) {
        REACHED(read_good);
        /*@ assert count <= 16; */
    }
    check_ring_is_sound(&self);
}

/* Images with arbitrary bytes, of every size up to the memory. */
void check_image(int most)
{
    OF_FOLLOWER(_config) config;
    OF_FOLLOWER(_tuning) tuning;
    OF(noslip_segment) segments[SEGMENTS];
    uint8_t image[IMAGE];
    uint32_t used = 0;
    int status;
    ANY(config);
    ANY(tuning);
    ANY(segments);
    ANY(image);
    status = OF_FOLLOWER(_load)(&config, segments, most, image, (uint32_t)Frama_C_interval(0, IMAGE));
    if (status >= 0) {
        REACHED(load_good);
        /*@ assert config.segments == &segments[0] && 0 <= config.count <= most; */
    } else {
        REACHED(load_refused);
    }
    if (OF_FOLLOWER(_load_tuning)(&tuning, image, (uint32_t)Frama_C_interval(0, IMAGE)) >= 0) {
        REACHED(load_tuning_good);
    }
    config.segments = segments;
    config.count = Frama_C_interval(-9, SEGMENTS);
    status = OF_FOLLOWER(_save)(&config, image, (uint32_t)Frama_C_interval(0, IMAGE), &used);
    if (status >= 0) {
        REACHED(save_good);
    } else {
        REACHED(save_refused);
    }
    if (OF_FOLLOWER(_save_tuning)(&tuning, image, (uint32_t)Frama_C_interval(0, IMAGE), &used) >= 0) {
        REACHED(save_tuning_good);
    }
}

int main(void)
{
    int most;
    check_ring();
    for (most = 0; most <= SEGMENTS; most++) {
        check_image(most);
    }
    REACHED(end);
    return 0;
}
