{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% macro f(name) %}@{ own(robot ~ "_follower_" ~ name) }{% endmacro %}
{% set self = own(robot ~ "_telemetry") %}
/*
 * @{ self }.h - config and ticks of the follower of @{ robot } as bytes: for flash, and for telemetry.
{% for line in banner %}
 * @{ line }
{% endfor %}
 *
 * Flash:      save writes a config with its path as an image, load reads it: see noslip_image.h.
 * Telemetry:  describe once, after init and after each update; record at each tick: see noslip_telemetry.h.
 */
#ifndef @{ self | upper }_H
#define @{ self | upper }_H

#include "@{ own(robot ~ "_follower") }.h"
#include "noslip_telemetry.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Bytes of the image of a config with `count` segments. */
#define @{ f("image") | upper }(count) (@{ size }u + @{ row_size }u * (uint32_t)(count))

/* What update changes, as one struct. */
typedef struct @{ f("tuning") } {
    @{ own(robot ~ "_params") } params;
    @{ own(law ~ "_gains") } gains;
    @{ own(robot ~ "_options") } limits;
} @{ f("tuning") };

#define @{ f("tuning_image") | upper } @{ in_use_size }u /* bytes of its image */

/* Writes the image of a config and its segments; `used` receives its bytes. Errors: see noslip_image_save. */
int @{ f("save") }(const @{ f("config") } *config, uint8_t *image, uint32_t size, uint32_t *used);

/*
 * Reads an image of at most `size` bytes into a config and its segments, of which there may be `most`; the caller keeps
 * both for the follower. On an error nothing changes: NOSLIP_DAMAGED, NOSLIP_OTHER_VERSION, NOSLIP_OTHER_MODEL,
 * NOSLIP_FULL, NOSLIP_NULL, see noslip_image_load. Whether the values are valid is checked by init.
 */
NOSLIP_NODISCARD int @{ f("load") }(@{ f("config") } *config, @{ n("segment") } *segments, int most, const uint8_t *image,
    uint32_t size);

/* The same for parameters, gains and limits, such as those that came over a bus; update checks the values. */
int @{ f("save_tuning") }(const @{ f("tuning") } *tuning, uint8_t *image, uint32_t size, uint32_t *used);
NOSLIP_NODISCARD int @{ f("load_tuning") }(@{ f("tuning") } *tuning, const uint8_t *image, uint32_t size);

/*
 * Writes the name of the robot, the config and what is in use now as frames. `image` is memory for the config,
 * @{ f("image") | upper }(count) bytes; it may be reused afterwards. Errors: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_FULL.
 */
int @{ f("describe") }(const @{ own(robot ~ "_follower") } *self, noslip_telemetry *to, uint8_t *image, uint32_t size);

/*
 * Writes the record of the last tick: its arguments and results, and what the follower computed. NULL for the counts
 * of a tick by angles: set `dt` and `turned` then. Errors: NOSLIP_NULL, NOSLIP_NOT_READY.
 */
int @{ f("record") }(const @{ own(robot ~ "_follower") } *self, const uint32_t counts[2], uint32_t missed, int status,
    const @{ real } command[2], @{ n("record") } *record);

#ifdef __cplusplus
}
#endif

#endif
