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
    REACHED(end);
    return 0;
}
