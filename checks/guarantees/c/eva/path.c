/*
 * path.c - noslip_path for EVA, in the scalar REAL with SUFFIX: init with arbitrary bits in all arguments, then look and update.
 *
 * Both require and keep the properties in check_is_sound, so that the results hold for any sequence of calls. It is not proved, since
 * it needs relations that intervals do not represent, that the other numbers of a guide are finite, and zero with an error. The
 * fuzzers check this.
 */
#include "eva.h"
#include "noslip_path.h"

#define SEGMENTS 3

static OF(noslip_segment) segments[SEGMENTS];

/* Asserts the properties of a path that is ready. */
void check_is_sound(const OF(noslip_path) *self, int count)
{
    /*@ assert self->segments == &segments[0] && self->count == count; */
    /*@ assert 0 <= self->guide.segment < count; */
    /*@ assert NOSLIP_ALONG <= self->current.stage <= NOSLIP_AT_STOP; */
    /*@ assert self->guide.backward == 0 || self->guide.backward == 1; */
}

/* Any path with these properties and a creep that init accepts. */
void make_path(OF(noslip_path) *self, int count, int closed, int segment)
{
    ANY(*self);
    self->segments = segments;
    self->count = count;
    self->closed = closed;
    self->current.stage = Frama_C_interval(NOSLIP_ALONG, NOSLIP_AT_STOP);
    self->guide.segment = segment;
    self->guide.backward = Frama_C_interval(0, 1);
    self->creep = BETWEEN(0, LARGEST);
}

/* Asserts the properties of a guide after each call. */
void check_guide(const OF(noslip_guide) *guide, int status, int count)
{
    /*@ assert status >= NOSLIP_UNSTABLE && status <= NOSLIP_ARRIVED; */
    /*@ assert 0 <= guide->segment < count; */
    /*@ assert \is_finite(guide->left); */
    /*@ assert \is_finite(guide->foot.distance); */
    /*@ assert \is_finite(guide->foot.curvature); */
}

void check_init(int count, int closed)
{
    OF(noslip_path_options) options;
    OF(noslip_path_fault) fault;
    OF(noslip_path) self;
    int status;
    ANY(options);
    ANY(self);
    options.closed = closed;
    status = OF(noslip_path_init)(&self, segments, count, &options, &fault);
    /*@ assert \is_finite(fault.size); */
    if (status == NOSLIP_OK) {
        REACHED(init_good);
        /*@ assert self.ready == NOSLIP_READY && fault.kind == NOSLIP_FAULT_NONE; */
        check_is_sound(&self, count);
    } else {
        REACHED(init_refused);
        /*@ assert self.ready == 0 && self.started == 0 && fault.kind != NOSLIP_FAULT_NONE; */
    }
}

void check_update(int count, int closed, int segment)
{
    OF(noslip_path) self;
    OF(noslip_guide) guide;
    REAL x, y, heading, speed;
    int status;
    ANY(x);
    ANY(y);
    ANY(heading);
    ANY(speed);
    make_path(&self, count, closed, segment);
    status = OF(noslip_path_look)(&self, x, y, heading, speed, &guide);
    if (status == NOSLIP_ARRIVED) {
        REACHED(look_arrived);
    } else if (status >= 0) {
        REACHED(look_good);
    } else {
        REACHED(look_refused);
    }
    check_guide(&guide, status, count);
    status = OF(noslip_path_update)(&self, x, y, heading, speed, &guide);
    if (status == NOSLIP_ARRIVED) {
        REACHED(update_arrived);
    } else if (status >= 0) {
        REACHED(update_good);
    } else {
        REACHED(update_refused);
    }
    check_guide(&guide, status, count);
    check_is_sound(&self, count);
}

int main(void)
{
    int count, closed, segment;
    ANY(segments);
    check_init(Frama_C_interval(-9, 0), 0);
    check_init(1, Frama_C_interval(2, 9));
    for (count = 1; count <= SEGMENTS; count++) {
        for (closed = 0; closed <= 1; closed++) {
            check_init(count, closed);
            for (segment = 0; segment < count; segment++) {
                check_update(count, closed, segment);
            }
        }
    }
    REACHED(end);
    return 0;
}
