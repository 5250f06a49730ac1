{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% macro f(name) %}@{ own(robot ~ "_follower_" ~ name) }{% endmacro %}
{% macro table(name, struct, members) %}
static const noslip_field @{ name }[] = {
{% for member in members %}
    {offsetof(@{ struct }, @{ member.path }), @{ member.count }, sizeof(@{ real if member.real else "int" })},
{% endfor %}
};
{% endmacro %}
{% set self = own(robot ~ "_telemetry") %}
/*
 * @{ self }.c - config and ticks of the follower of @{ robot } as bytes, see @{ self }.h
{% for line in banner %}
 * @{ line }
{% endfor %}
 */
#include <stddef.h>

#include "@{ self }.h"

/* -- layout of the images ------------------------------------------------------------------------------------------ */

/* The numbers of a config: place of the first, how many follow each other, their width. */
@{ table("config_fields", f("config"), fields) }
@{ table("segment_fields", n("segment"), row) }
/* What update changes. */
@{ table("tuning_fields", f("tuning"), in_use) }
#define COUNT(fields) (int)(sizeof(fields) / sizeof(fields)[0])
#define MODEL @{ "0x%08xu" | format(model) } /* of robot and law */

/* Sets a layout. It is not a constant object, since that would have addresses, which a loader may have to write. */
static void set_layout(noslip_layout *layout, const noslip_field *fields, int count, uint32_t hash)
{
    layout->fields = fields;
    layout->field_count = count;
    layout->row = NULL;
    layout->row_count = 0;
    layout->row_size = 0;
    layout->real = sizeof(@{ real });
    layout->hash = hash;
    layout->model = MODEL;
}

static void set_config_layout(noslip_layout *layout)
{
    set_layout(layout, config_fields, COUNT(config_fields), @{ "0x%08xu" | format(hash) });
    layout->row = segment_fields;
    layout->row_count = COUNT(segment_fields);
    layout->row_size = sizeof(@{ n("segment") });
}

static void set_tuning_layout(noslip_layout *layout)
{
    set_layout(layout, tuning_fields, COUNT(tuning_fields), @{ "0x%08xu" | format(in_use_hash) });
}

/* -- images -------------------------------------------------------------------------------------------------------- */

int @{ f("save") }(const @{ f("config") } *config, uint8_t *image, uint32_t size, uint32_t *used)
{
    noslip_layout layout;
    if (config == NULL) {
        return NOSLIP_NULL;
    }
    set_config_layout(&layout);
    return noslip_image_save(&layout, config, config->segments, config->count, image, size, used);
}

int @{ f("load") }(@{ f("config") } *config, @{ n("segment") } *segments, int most, const uint8_t *image, uint32_t size)
{
    noslip_layout layout;
    int count = 0, status;
    set_config_layout(&layout);
    status = noslip_image_load(&layout, config, segments, most, &count, image, size);
    if (status >= 0) {
        config->segments = segments;
        config->count = count;
    }
    return status;
}

int @{ f("save_tuning") }(const @{ f("tuning") } *tuning, uint8_t *image, uint32_t size, uint32_t *used)
{
    noslip_layout layout;
    set_tuning_layout(&layout);
    return noslip_image_save(&layout, tuning, NULL, 0, image, size, used);
}

int @{ f("load_tuning") }(@{ f("tuning") } *tuning, const uint8_t *image, uint32_t size)
{
    noslip_layout layout;
    int none;
    set_tuning_layout(&layout);
    return noslip_image_load(&layout, tuning, NULL, 0, &none, image, size);
}

/* -- telemetry ----------------------------------------------------------------------------------------------------- */

int @{ f("describe") }(const @{ own(robot ~ "_follower") } *self, noslip_telemetry *to, uint8_t *image, uint32_t size)
{
    static const uint8_t robot[] = "@{ robot }";
    @{ f("tuning") } tuning;
    uint32_t used = 0;
    int status;
    if (self == NULL || to == NULL || image == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    status = noslip_telemetry_send(to, NOSLIP_FRAME_ROBOT, robot, (uint32_t)sizeof robot - 1u);
    status = status < 0 ? status : @{ f("save") }(self->config, image, size, &used);
    status = status < 0 ? status : noslip_telemetry_send(to, NOSLIP_FRAME_CONFIG, image, used);
    noslip_copy(&tuning.params, &self->params, sizeof tuning.params);
    noslip_copy(&tuning.gains, &self->gains, sizeof tuning.gains);
    noslip_copy(&tuning.limits, &self->limits, sizeof tuning.limits);
    status = status < 0 ? status : @{ f("save_tuning") }(&tuning, image, size, &used);
    return status < 0 ? status : noslip_telemetry_send(to, NOSLIP_FRAME_UPDATE, image, used);
}

int @{ f("record") }(const @{ own(robot ~ "_follower") } *self, const uint32_t counts[2], uint32_t missed, int status,
    const @{ real } command[2], @{ n("record") } *record)
{
    int i;
    if (self == NULL || command == NULL || record == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    record->tick = 0;
    record->missed = missed;
    record->status = status;
    record->watchdog = (int)self->watchdog.state + 256 * (int)self->watchdog.reason;
    record->segment = self->path.guide.segment;
    record->dt = 0;
    for (i = 0; i < 2; i++) {
        record->counts[i] = counts != NULL ? counts[i] : 0;
        record->turned[i] = 0;
        record->torque[i] = self->torque[i];
        record->command[i] = command[i];
    }
    record->pose.x = self->odometry.pose.x;
    record->pose.y = self->odometry.pose.y;
    record->pose.heading = self->odometry.pose.heading;
    record->rate[0] = self->state.@{ rates[0] };
    record->rate[1] = self->state.@{ rates[1] };
    record->desired_speed = self->reference.speed;
    record->desired_speed_rate = self->reference.speed_rate;
    record->desired_distance[0] = self->reference.distance;
    record->desired_distance[1] = self->reference.distance_rate;
    record->desired_distance[2] = self->reference.distance_acceleration;
    record->distance = self->path.guide.foot.distance;
    record->speed = self->speed;
    return NOSLIP_OK;
}
