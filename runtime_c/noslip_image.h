/*
 * noslip_image.h - a config as bytes that are the same on every machine: for flash, for a bus, at the head of telemetry.
 *
 * An image begins with its format, the hash of the fields that it holds and that of the robot's law, and ends with a CRC. Hence what
 * is loaded is what was saved, by a program for the same law. Whether the values are valid is checked by init, as for any config.
 * The generated NAME_telemetry.h has save and load for the config of a follower.
 *
 *     bytes 0 to 23    6 words: NOSLIP_IMAGE_MAGIC; NOSLIP_IMAGE_FORMAT + 256 * bytes of a real; bytes of the image; hash of the
 *                      fields; hash of the model; number of rows
 *     then             the fields, then the rows, such as the segments of a path
 *     last 4 bytes     CRC-32 of all bytes before
 *
 * Numbers are little-endian: integers and enums 4 bytes, reals 4 (float) or 8 (double).
 */
#ifndef NOSLIP_IMAGE_H
#define NOSLIP_IMAGE_H

#include <stdint.h>

#include "noslip_status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define NOSLIP_IMAGE_MAGIC 0x6c736e6fu /* "onsl" */
#define NOSLIP_IMAGE_FORMAT 1u
#define NOSLIP_IMAGE_HEAD 24u /* bytes before the fields */
#define NOSLIP_IMAGE_TAIL 4u  /* bytes after the rows */

/* Numbers of the same width that lie one after the other in a struct. */
typedef struct noslip_field {
    uint16_t offset; /* bytes from the start of the struct */
    uint16_t count;  /* of numbers */
    uint16_t width;  /* bytes of a number: 4 or 8 */
} noslip_field;

/* What an image holds: the fields of one struct, then those of each row of an array. */
typedef struct noslip_layout {
    const noslip_field *fields;
    const noslip_field *row;
    int field_count;
    int row_count;     /* fields of a row */
    uint32_t row_size; /* bytes from one row to the next in memory */
    uint32_t real;     /* bytes of a real */
    uint32_t hash;     /* of the names and kinds of the fields */
    uint32_t model;    /* of the robot and its law */
} noslip_layout;

/* Returns the CRC-32 (IEEE 802.3, as zlib computes it) of bytes that follow those whose CRC is `crc`, 0 at the start. */
uint32_t noslip_crc32(uint32_t crc, const uint8_t *bytes, uint32_t count);

/*
 * Writes the image of a config and of its `count` rows; `used` receives its bytes. Returns NOSLIP_NULL, NOSLIP_BAD_PARAMETER for a
 * negative count, or NOSLIP_FULL if `size` is less; then nothing but `used` is written.
 */
int noslip_image_save(const noslip_layout *layout, const void *config, const void *rows, int count, uint8_t *image, uint32_t size,
                      uint32_t *used);

/*
 * Reads an image of at most `size` bytes into a config and up to `most` rows; `count` receives their number. On an error nothing
 * is written: NOSLIP_NULL; NOSLIP_DAMAGED if it is not a whole image with its CRC, such as erased flash; NOSLIP_OTHER_VERSION if it has
 * another format, other fields or the other scalar; NOSLIP_OTHER_MODEL for another robot or law; NOSLIP_FULL if it has more rows.
 */
NOSLIP_NODISCARD int noslip_image_load(const noslip_layout *layout, void *config, void *rows, int most, int *count,
                                       const uint8_t *image, uint32_t size);

#ifdef __cplusplus
}
#endif

#endif
