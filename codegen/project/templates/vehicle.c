{% set config = own(robot ~ "_follower_config") %}
/*
 * vehicle.c - the numbers of this vehicle, SI; @{ own(robot ~ "_follower") }.h describes them.
{% for what in assumed %}
 * Assumed: @{ what }.
{% endfor %}
 */
#include "vehicle.h"

const @{ config } *vehicle_config(void)
{
    static const @{ own("noslip_segment") } segments[] = {
{% for segment in segments %}
        @{ segment },
{% endfor %}
    };
    static const @{ config } config = {
{% for name, value in members.items() %}
        .@{ name } = @{ value },
{% endfor %}
        .segments = segments,
        .count = @{ count },
    };
    return &config;
}
