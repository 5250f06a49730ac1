/*
 * tracker.c - vehicles on courses for EVA, in the scalar REAL with SUFFIX: arbitrary bits in all arguments.
 *
 * Proved is that nothing undefined happens, whatever the stretches of the course are, and that the tracker stays on them.
 */
#include "eva.h"
#include "noslip_course.h"

#define PARTS 2

int main(void)
{
    OF(noslip_stretch) stretches[NOSLIP_COURSE_ROOM(PARTS)];
    OF(noslip_course) self;
    OF(noslip_course_tracker_options) following;
    OF(noslip_course_tracker) tracker;
    OF(noslip_course_guide) guide;
    int status, k;
    self.stretches = stretches;
    self.count = COUNT(stretches);
    self.ready = any_int;
    ANY(stretches);
    /*@ loop unroll 5; */
    for (k = 0; k < COUNT(stretches); k++) {
        stretches[k].terms = Frama_C_interval(1, NOSLIP_COURSE_TERMS);
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
