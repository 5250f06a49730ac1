{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% set self = own(robot ~ "_ekf") %}
/*
 * @{ self }.c - extended Kalman filter for the pose of @{ robot }, @{ real }
{% for line in banner %}
 * @{ line }
{% endfor %}
 */
#define NOSLIP_OWN
#include "@{ self }.h"
{% for header in headers %}
#include "@{ header }.h"
{% endfor %}

int @{ own(robot ~ "_ekf_init") }(@{ self } *self, const @{ self_config } *config)
{
    const @{ params } *params;
    int status;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->filter.ready = 0;
    if (config == NULL) {
        return NOSLIP_NULL;
    }
    params = &config->params;
    status = @{ own(robot ~ "_check_params") }(params);
    if (status != NOSLIP_OK) {
        return status;
    }
    if (@{ invalid }) {
        return NOSLIP_BAD_PARAMETER;
    }
    status = @{ n("ekf_start") }(&self->filter, &config->filter, @{ count });
    if (status != NOSLIP_OK) {
        return status;
    }
    /* without a gyro its bias does not matter */
    @{ n("ekf_set") }(&self->filter, 3, 0, config->gyro_noise > 0 ? config->bias_sd : 1);
{% for scale in scales %}
    @{ n("ekf_set") }(&self->filter, @{ loop.index + 3 }, 1, config->@{ scale }_sd);
{% endfor %}
    self->has_gyro = config->gyro_noise > 0;
@{ constants }
    self->filter.ready = NOSLIP_READY;
    return status;
}

@{ functions | join("\n\n") }

int @{ own(robot ~ "_ekf_tick") }(@{ tick })
{
    @{ real } moved[3], others[@{ count - 3 }], factors[@{ size }], spent[2];
    int status = NOSLIP_NULL;
    if (pose == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->filter.ready != NOSLIP_READY) {
        pose->x = 0;
        pose->y = 0;
        pose->heading = 0;
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    if (turned != NULL@{ " && measured != NULL" if measured }) {
        const @{ real } rate = gyro != NULL ? *gyro : 0;
        if (!(@{ finite } && @{ n("is_finite") }(dt) && @{ n("is_finite") }(rate))) {
            status = NOSLIP_NONFINITE;
        } else if (!(dt > 0) || (gyro != NULL && !self->has_gyro)) {
            status = NOSLIP_BAD_PARAMETER;
        } else {
            status = gyro != NULL ? @{ own(robot ~ "_ekf_gyro") }(@{ call }, rate, dt, moved, others, factors, spent)
                                  : @{ own(robot ~ "_ekf_wheels") }(@{ call }, dt, moved, others, factors, spent);
        }
        if (status == NOSLIP_OK) {
            status = @{ n("ekf_advance") }(&self->filter, moved, others, factors, @{ count }, dt, spent);
        }
    }
    pose->x = self->filter.state[0];
    pose->y = self->filter.state[1];
    pose->heading = self->filter.state[2];
    return status;
}
