{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% set self = own(robot ~ "_follower") %}
/*
 * loop.c - @{ robot } on a path, from the counters of its wheels to its drives. Yours: the three functions that are extern, and the
 * numbers in vehicle.c.
 *
 * control_loop returns where init rejects the numbers, and where the vehicle stops on an error. It needs no memory but its own stack.
 */
#include "vehicle.h"

extern uint32_t wait_for_tick(void);              /* a timer; returns how many ticks were missed */
extern void read_counters(uint32_t counts[2]);    /* of the encoders: @{ wheels | join(", ") } */
extern void set_commands(const @{ real } command[2]); /* N m, or with a motor's model A, V or a duty, or with velocity drives rad/s */

int control_loop(void);

int control_loop(void)
{
    static const @{ real } none[2] = {0, 0};
    @{ self } follower;
    uint32_t counts[2];
    @{ real } command[2];
    int status = @{ own(robot ~ "_follower_init") }(&follower, vehicle_config());

    while (status >= 0 && follower.watchdog.state != NOSLIP_WATCHDOG_STOP) {
        const uint32_t missed = wait_for_tick();
        read_counters(counts);
        (void)@{ own(robot ~ "_follower_tick") }(&follower, counts, missed, command); /* errors that pass are bridged by the watchdog */
        set_commands(command);
    }
    set_commands(none);
    return status < 0 ? status : follower.watchdog.status; /* noslip_status_name(status) says what it was */
}
