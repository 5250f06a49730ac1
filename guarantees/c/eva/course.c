/*
 * course.c - courses for EVA, in the scalar REAL with SUFFIX: arbitrary bits in all arguments.
 *
 * Proved is that nothing undefined happens, and that init fills no more stretches than there is room for. That what is written is
 * finite needs relations that intervals do not represent; the fuzzers check it.
 */
#include "eva.h"
#include "noslip_course.h"

#define PARTS 2

int main(void)
{
    OF(noslip_course_options) options;
    OF(noslip_stretch) stretches[NOSLIP_COURSE_ROOM(PARTS)];
    OF(noslip_course) self;
    OF(noslip_course_point) point;
    OF(noslip_course_tracker_options) following;
    OF(noslip_course_tracker) tracker;
    OF(noslip_course_guide) guide;
    REAL lengths[PARTS], curvatures[PARTS + 1], length;
    int status, k;
    ANY(options);
    ANY(lengths);
    ANY(curvatures);
    ANY(stretches);
    ANY(self);
    options.lengths = lengths;
    options.curvatures = curvatures;
    options.count = any_int;
    status = OF(noslip_course_init)(&self, stretches, COUNT(stretches), &options);
    if (status == NOSLIP_OK) {
        REACHED(init_good);
        /*@ assert 1 <= self.count <= 5 && self.ready == NOSLIP_READY; */
    } else {
        REACHED(init_refused);
        /*@ assert self.ready == 0; */
    }
    self.stretches = stretches;
    self.count = Frama_C_interval(1, COUNT(stretches));
    self.ready = NOSLIP_READY;
    ANY(stretches);
    /*@ loop unroll 5; */
    for (k = 0; k < COUNT(stretches); k++) {
        stretches[k].terms = Frama_C_interval(1, NOSLIP_COURSE_TERMS);
    }
    status = OF(noslip_course_at)(&self, any_real(), any_real(), &point);
    if (status == NOSLIP_OK) {
        REACHED(point_good);
    } else {
        REACHED(point_refused);
    }
    length = any_real();
    status = OF(noslip_course_nearest)(&self, any_real(), any_real(), &length);
    if (status == NOSLIP_OK) {
        REACHED(nearest_good);
    } else {
        REACHED(nearest_refused);
    }
    ANY(following);
    ANY(tracker);
    status = OF(noslip_course_tracker_init)(&tracker, &self, &following);
    if (status == NOSLIP_OK) {
        REACHED(tracker_good);
        /*@ assert tracker.now.first == 0 && 0 <= tracker.now.last < 5 && tracker.ready == NOSLIP_READY; */
    } else {
        REACHED(tracker_refused);
        /*@ assert tracker.ready == 0; */
    }
    ANY(tracker);
    tracker.course = &self;
    tracker.now.first = Frama_C_interval(0, COUNT(stretches) - 1);
    tracker.now.last = Frama_C_interval(0, COUNT(stretches) - 1);
    tracker.now.piece = Frama_C_interval(0, COUNT(stretches));
    self.count = COUNT(stretches);
    status = OF(noslip_course_tracker_look)(&tracker, any_real(), any_real(), any_real(), any_real(), &guide);
    if (status >= 0) {
        REACHED(look_good);
    } else {
        REACHED(look_refused);
    }
    status = OF(noslip_course_tracker_update)(&tracker, any_real(), any_real(), any_real(), any_real(), &guide);
    if (status >= 0) {
        REACHED(update_good);
        /*@ assert 0 <= tracker.now.first < 5 && 0 <= tracker.now.last < 5; */
    } else {
        REACHED(update_refused);
    }
    REACHED(end);
    return 0;
}
