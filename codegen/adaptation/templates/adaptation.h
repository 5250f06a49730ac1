{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% set self = own(robot ~ "_adaptation") %}
/*
 * @{ self }.h - parameters of @{ robot } that change, learned while it drives, @{ real }
{% for line in banner %}
 * @{ line }
{% endfor %}
 *
 * Learned: {% for q in adapted %}@{ q.name } (@{ q.unit })@{ ", " if not loop.last }{% endfor %}. noslip_adaptation.h describes how.
 */
#ifndef @{ self | upper }_H
#define @{ self | upper }_H

#include "@{ own(robot ~ "_dynamics") }.h"
#include "noslip_adaptation.h"

@{ version_check }

#ifdef __cplusplus
extern "C" {
#endif

/* What the adaptation is told. */
typedef struct @{ own(robot ~ "_adaptation_config") } {
    @{ own(robot ~ "_params") } params; /* at first; those learned within their bounds */
{% for q in adapted %}
    @{ real } @{ q.in_c }_least; /* @{ q.unit }: bounds of @{ q.name } */
    @{ real } @{ q.in_c }_most; /* @{ q.unit } */
{% endfor %}
    @{ n("adaptation_options") } options; /* noise, dead zone, forgetting */
} @{ own(robot ~ "_adaptation_config") };

/* The adaptation: initialized by init, owned by the caller, who does not write to it. */
typedef struct @{ self } {
    @{ n("adaptation") } core; /* estimates, relative to the bounds, and covariance */
    @{ own(robot ~ "_dynamics") } least; /* with all parameters that are learned at their least */
    @{ own(robot ~ "_dynamics") } most[@{ adapted | length }]; /* with one of them at its most */
    @{ own(robot ~ "_params") } params; /* in use */
    @{ own(robot ~ "_state") } last; /* state at the last call */
    @{ real } bounds[@{ adapted | length }][2]; /* least and most */
    int started; /* whether `last` is known */
} @{ self };

/*
 * Initializes the adaptation. NOSLIP_BAD_PARAMETER: a parameter or option is invalid, a least is not below its most, or a
 * parameter not within both; NOSLIP_SINGULAR: a motion without mass.
 */
NOSLIP_NODISCARD int @{ own(robot ~ "_adaptation_init") }(@{ self } *self, const @{ own(robot ~ "_adaptation_config") } *config);

/*
 * Learns from the motion since the last call and writes the parameters to use.
 * state: now; its coordinates do not jump between two calls (a heading by whole turns is a jump)
 * tau[@{ inputs | length }]: @{ inputs | join(", ") }, which acted since the last call; NULL: not known, nothing is learned
 * dt: s, since the last call, positive
 * On an error nothing changes, and the parameters are those in use: NOSLIP_NULL; NOSLIP_NOT_READY (zeros); NOSLIP_NONFINITE;
 * NOSLIP_BAD_PARAMETER (dt); NOSLIP_RANGE (angles); NOSLIP_SINGULAR.
 */
int @{ own(robot ~ "_adaptation_step") }(@{ self } *self, const @{ own(robot ~ "_state") } *state, const @{ real } *tau, @{ real } dt, @{ own(robot ~ "_params") } *params);

#ifdef __cplusplus
}
#endif

#endif
