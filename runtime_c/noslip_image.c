/* noslip_image.c - a config as bytes, see noslip_image.h. */
#include "noslip_image.h"
#include "noslip_controller.h"

uint32_t noslip_crc32(uint32_t crc, const uint8_t *bytes, uint32_t count)
{
    static const uint32_t table[16] = {/* remainder of each half of a byte */
                                       0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu, 0x76dc4190u, 0x6b6b51f4u,
                                       0x4db26158u, 0x5005713cu, 0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu,
                                       0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu};
    uint32_t i;
    crc = ~crc;
    for (i = 0; i < count; i++) {
        crc ^= bytes[i];
        crc = table[crc & 15u] ^ (crc >> 4);
        crc = table[crc & 15u] ^ (crc >> 4);
    }
    return ~crc;
}

static void write_word(uint8_t *bytes, uint32_t word)
{
    bytes[0] = (uint8_t)(word & 255u);
    bytes[1] = (uint8_t)((word >> 8) & 255u);
    bytes[2] = (uint8_t)((word >> 16) & 255u);
    bytes[3] = (uint8_t)(word >> 24);
}

static uint32_t read_word(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] | ((uint32_t)bytes[1] << 8) | ((uint32_t)bytes[2] << 16) | ((uint32_t)bytes[3] << 24);
}

/* Writes a number from memory. */
static void write_number(uint8_t *bytes, const uint8_t *from, uint32_t width)
{
    if (width == 8) {
        uint64_t number;
        noslip_copy(&number, from, sizeof number);
        write_word(bytes, (uint32_t)(number & 0xffffffffu));
        write_word(&bytes[4], (uint32_t)(number >> 32));
    } else {
        uint32_t number;
        noslip_copy(&number, from, sizeof number);
        write_word(bytes, number);
    }
}

/* Reads a number into memory. */
static void read_number(const uint8_t *bytes, uint8_t *to, uint32_t width)
{
    if (width == 8) {
        const uint64_t number = (uint64_t)read_word(bytes) | ((uint64_t)read_word(&bytes[4]) << 32);
        noslip_copy(to, &number, sizeof number);
    } else {
        const uint32_t number = read_word(bytes);
        noslip_copy(to, &number, sizeof number);
    }
}

/* Returns the bytes that fields take in an image. */
static uint32_t bytes_of(const noslip_field *fields, int count)
{
    uint32_t sum = 0;
    int i;
    for (i = 0; i < count; i++) {
        sum += (uint32_t)fields[i].count * fields[i].width;
    }
    return sum;
}

/* Returns the bytes of an image with `count` rows; 0 if their number is not a size. */
static uint32_t image_size(const noslip_layout *layout, uint32_t count)
{
    const uint32_t row = bytes_of(layout->row, layout->row_count);
    const uint32_t fixed = NOSLIP_IMAGE_HEAD + bytes_of(layout->fields, layout->field_count) + NOSLIP_IMAGE_TAIL;
    return row > 0 && count > (UINT32_MAX - fixed) / row ? 0 : fixed + count * row;
}

/* Writes the fields of a struct; returns the place after them. */
static uint8_t *write_fields(const noslip_field *fields, int count, const uint8_t *from, uint8_t *to)
{
    int i;
    for (i = 0; i < count; i++) {
        uint32_t k;
        for (k = 0; k < fields[i].count; k++) {
            write_number(to, &from[fields[i].offset + k * fields[i].width], fields[i].width);
            to += fields[i].width;
        }
    }
    return to;
}

/* Reads the fields of a struct; returns the place after them. */
static const uint8_t *read_fields(const noslip_field *fields, int count, const uint8_t *from, uint8_t *to)
{
    int i;
    for (i = 0; i < count; i++) {
        uint32_t k;
        for (k = 0; k < fields[i].count; k++) {
            read_number(from, &to[fields[i].offset + k * fields[i].width], fields[i].width);
            from += fields[i].width;
        }
    }
    return from;
}

int noslip_image_save(const noslip_layout *layout, const void *config, const void *rows, int count, uint8_t *image, uint32_t size,
                      uint32_t *used)
{
    uint32_t needed, i;
    uint8_t *place;
    if (layout == NULL || config == NULL || image == NULL || used == NULL || (rows == NULL && count > 0)) {
        return NOSLIP_NULL;
    }
    needed = count < 0 ? 0 : image_size(layout, (uint32_t)count);
    *used = needed;
    if (needed == 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (needed > size) {
        return NOSLIP_FULL;
    }
    write_word(image, NOSLIP_IMAGE_MAGIC);
    write_word(&image[4], NOSLIP_IMAGE_FORMAT + 256u * layout->real);
    write_word(&image[8], needed);
    write_word(&image[12], layout->hash);
    write_word(&image[16], layout->model);
    write_word(&image[20], (uint32_t)count);
    place = write_fields(layout->fields, layout->field_count, (const uint8_t *)config, &image[NOSLIP_IMAGE_HEAD]);
    for (i = 0; i < (uint32_t)count; i++) {
        place = write_fields(layout->row, layout->row_count, (const uint8_t *)rows + i * layout->row_size, place);
    }
    write_word(place, noslip_crc32(0, image, needed - NOSLIP_IMAGE_TAIL));
    return NOSLIP_OK;
}

/* Checks an image; `count` receives the number of its rows. */
static int check(const noslip_layout *layout, int most, const uint8_t *image, uint32_t size, uint32_t *count)
{
    uint32_t length;
    if (size < NOSLIP_IMAGE_HEAD + NOSLIP_IMAGE_TAIL || read_word(image) != NOSLIP_IMAGE_MAGIC) {
        return NOSLIP_DAMAGED;
    }
    length = read_word(&image[8]);
    if (length < NOSLIP_IMAGE_HEAD + NOSLIP_IMAGE_TAIL || length > size ||
        read_word(&image[length - NOSLIP_IMAGE_TAIL]) != noslip_crc32(0, image, length - NOSLIP_IMAGE_TAIL)) {
        return NOSLIP_DAMAGED;
    }
    if (read_word(&image[4]) != NOSLIP_IMAGE_FORMAT + 256u * layout->real || read_word(&image[12]) != layout->hash) {
        return NOSLIP_OTHER_VERSION;
    }
    if (read_word(&image[16]) != layout->model) {
        return NOSLIP_OTHER_MODEL;
    }
    *count = read_word(&image[20]);
    if (length != image_size(layout, *count)) {
        return NOSLIP_DAMAGED;
    }
    return most < 0 || *count > (uint32_t)most ? NOSLIP_FULL : NOSLIP_OK;
}

int noslip_image_load(const noslip_layout *layout, void *config, void *rows, int most, int *count, const uint8_t *image,
                      uint32_t size)
{
    const uint8_t *place;
    uint32_t number = 0, i;
    int status;
    if (layout == NULL || config == NULL || count == NULL || image == NULL || (rows == NULL && most > 0)) {
        return NOSLIP_NULL;
    }
    status = check(layout, most, image, size, &number);
    if (status < 0) {
        return status;
    }
    place = read_fields(layout->fields, layout->field_count, &image[NOSLIP_IMAGE_HEAD], (uint8_t *)config);
    for (i = 0; i < number; i++) {
        place = read_fields(layout->row, layout->row_count, place, (uint8_t *)rows + i * layout->row_size);
    }
    *count = (int)number;
    return NOSLIP_OK;
}
