/*
 * loop.c - @{ about }, called at a fixed rate. Yours: the four functions that are extern, and the numbers.
 *
 * control_loop answers where init refuses the numbers; else it goes on for ever. It needs no memory but its own stack.
 */
#include "@{ own(law) }.h"

@{ externs | join("\n") }

int control_loop(void);

int control_loop(void)
{
    static const @{ own(law ~ "_config") } config = @{ config }; /* examples: put in yours */
    static const @{ own(law ~ "_gains") } gains = @{ gains };
    static const @{ own(robot ~ "_options") } options = {0}; /* no limits; zeros on an error */
    static const @{ real } none[@{ inputs }] = {@{ zeros }};
    @{ own(law ~ "_reference") } reference;
    @{ own(robot ~ "_params") } params;
    @{ own(robot ~ "_state") } state;
    @{ own(law) } law;
    @{ real } @{ answer }[@{ inputs }];
{% if extension %}
    const @{ real } period = @{ period }; /* s, between two ticks: put in yours */
    @{ real } dt = 0; /* s, since the step before */
{% endif %}
    int status = @{ own(robot ~ "_default_params") }(&params); /* then put in what differs in yours */

    if (status == NOSLIP_OK) {
        status = @{ own(law ~ "_init") }(&law, &params, &config, &gains, &options);
    }
    while (status >= 0) {
        wait_for_tick();
        read_state(&state);
        read_reference(&reference);
        status = @{ own(law ~ "_step") }(&law, &state, &reference@{ ", dt" if extension else "" }, @{ answer }); /* on an error @{ answer } is zero: defined, never NaN */
{% if extension %}
        dt = period;
{% endif %}
        set_inputs(@{ answer });
    }
    set_inputs(none);
    return status; /* noslip_status_name(status) says what it was */
}
