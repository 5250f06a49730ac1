{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% set self = own(robot ~ "_follower") %}
/*
 * loop.c - @{ robot } on a path, from the counters of its wheels to its drives. Yours: the three functions that are extern, and the
 * numbers; @{ self }.h describes them.
 *
 * control_loop returns where init rejects the numbers, and where the vehicle stops on an error. It needs no memory but its own stack.
 */
#include "@{ self }.h"

extern uint32_t wait_for_tick(void);              /* a timer; returns how many ticks were missed */
extern void read_counters(uint32_t counts[2]);    /* of the encoders: @{ wheels | join(", ") } */
extern void set_commands(const @{ real } command[2]); /* N m, or with a motor's model A, V or a duty, or with velocity drives rad/s */

int control_loop(void);

int control_loop(void)
{
    static const @{ n("segment") } path[] = {{.length = @{ literal(5.0) }}}; /* examples: put in yours */
    static const @{ own(robot ~ "_follower_config") } config = {
        .period = @{ literal(0.01) }, .counts_per_turn = {@{ literal(40000.0) }, @{ literal(40000.0) }}, .counter_bits = 16,
        .fastest = @{ "{" ~ literal(20.0) ~ ", " ~ literal(5.0) ~ "}, .steering = " ~ literal(1.0) if steered else literal(20.0) }, .segments = path, .count = 1,
        .path = {.speed = @{ literal(0.5) }, .deceleration = @{ literal(0.4) }, .L = {@{ literal(0.25) }, @{ literal(0.25) }}},
        .astray = @{ literal(0.3) }, .gains = {@{ gains }},
        .limits = {.limit = {@{ literal(1.0) }, @{ literal(1.0) }}, .on_limit = NOSLIP_SLOW}, .watchdog = {3, 100, 50}};
    static const @{ real } none[2] = {0, 0};
    @{ self } follower;
    uint32_t counts[2];
    @{ real } command[2];
    int status = @{ own(robot ~ "_follower_init") }(&follower, &config);

    while (status >= 0 && follower.watchdog.state != NOSLIP_WATCHDOG_STOP) {
        const uint32_t missed = wait_for_tick();
        read_counters(counts);
        (void)@{ own(robot ~ "_follower_tick") }(&follower, counts, missed, command); /* errors that pass are bridged by the watchdog */
        set_commands(command);
    }
    set_commands(none);
    return status < 0 ? status : follower.watchdog.status; /* noslip_status_name(status) says what it was */
}
