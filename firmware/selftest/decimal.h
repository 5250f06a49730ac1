/*
 * decimal.h - a double as text that reads back as the same double: what printf writes with "%.17g", without a C library.
 *
 * A double is an integer times a power of two, which is an integer times a power of ten: that integer is computed exactly, in limbs
 * of nine digits, and rounded to 17 digits, half to even.
 */
#ifndef DECIMAL_H
#define DECIMAL_H

#include "noslip_real.h"

#define DECIMAL_SIZE 26     /* characters, with the zero at the end */
#define DECIMAL_DIGITS 17
#define DECIMAL_LIMBS 88    /* for 2^-1074, which has 751 digits, times 2^53 */
#define DECIMAL_BASE 1000000000u

typedef struct {
    uint32_t limb[DECIMAL_LIMBS]; /* the lowest first */
    int count;
} decimal_integer;

static inline void decimal_multiply(decimal_integer *integer, uint32_t factor)
{
    uint64_t carry = 0;
    int i;
    for (i = 0; i < integer->count; i++) {
        carry += (uint64_t)integer->limb[i] * factor;
        integer->limb[i] = (uint32_t)(carry % DECIMAL_BASE);
        carry /= DECIMAL_BASE;
    }
    if (carry > 0 && integer->count < DECIMAL_LIMBS) {
        integer->limb[integer->count++] = (uint32_t)carry;
    }
}

/* Multiplies by base^exponent; most = base^each fits into 30 bits. */
static inline void decimal_scale(decimal_integer *integer, uint32_t base, int exponent, uint32_t most, int each)
{
    for (; exponent >= each; exponent -= each) {
        decimal_multiply(integer, most);
    }
    for (; exponent > 0; exponent--) {
        decimal_multiply(integer, base);
    }
}

/* Writes all digits; returns their number. */
static inline int decimal_expand(const decimal_integer *integer, char digits[9 * DECIMAL_LIMBS])
{
    int i, k, count = 0;
    for (i = integer->count - 1; i >= 0; i--) {
        uint32_t unit = DECIMAL_BASE / 10;
        for (k = 0; k < 9; k++, unit /= 10) {
            const char digit = (char)('0' + integer->limb[i] / unit % 10);
            if (count > 0 || digit != '0') {
                digits[count++] = digit;
            }
        }
    }
    return count;
}

/* Rounds to DECIMAL_DIGITS, without zeros at the end; returns the number of digits. `more` is 1 where a carry adds one in front. */
static inline int decimal_round(char *digits, int count, int *more)
{
    int k, kept = count < DECIMAL_DIGITS ? count : DECIMAL_DIGITS;
    *more = 0;
    if (count > kept) {
        int up = digits[kept] > '5';
        for (k = kept + 1; digits[kept] == '5' && k < count; k++) {
            up = up || digits[k] != '0';
        }
        up = up || (digits[kept] == '5' && ((digits[kept - 1] - '0') & 1));
        for (k = kept - 1; up && k >= 0; k--) {
            up = digits[k] == '9';
            digits[k] = up ? '0' : (char)(digits[k] + 1);
        }
        if (up) {
            digits[0] = '1'; /* and zeros */
            *more = 1;
        }
    }
    while (kept > 1 && digits[kept - 1] == '0') {
        kept--;
    }
    return kept;
}

static inline char *decimal_copy(char *to, const char *from, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        *to++ = from[i];
    }
    return to;
}

/* Writes a number. */
static inline void decimal_write(char to[DECIMAL_SIZE], double value)
{
    noslip_bits bits;
    decimal_integer integer;
    char digits[9 * DECIMAL_LIMBS];
    uint64_t fraction;
    int exponent, binary, count, kept, more, k;
    bits.value = value;
    fraction = bits.bits & UINT64_C(0xfffffffffffff);
    binary = (int)(bits.bits >> 52 & 0x7ff);
    if (binary == 0x7ff && fraction != 0) {
        *decimal_copy(to, "nan", 3) = 0;
        return;
    }
    if (bits.bits >> 63 && (binary != 0 || fraction != 0)) { /* both zeros are 0 */
        *to++ = '-';
    }
    if (binary == 0x7ff || (binary == 0 && fraction == 0)) {
        *decimal_copy(to, binary != 0 ? "inf" : "0", binary != 0 ? 3 : 1) = 0;
        return;
    }
    fraction |= binary > 0 ? UINT64_C(1) << 52 : 0;
    binary = (binary > 0 ? binary : 1) - 1075;
    integer.limb[0] = (uint32_t)(fraction % DECIMAL_BASE);
    integer.limb[1] = (uint32_t)(fraction / DECIMAL_BASE);
    integer.count = 2;
    decimal_scale(&integer, 2, binary, UINT32_C(536870912), 29);
    decimal_scale(&integer, 5, -binary, UINT32_C(244140625), 12);
    digits[0] = '0';
    count = decimal_expand(&integer, digits);
    exponent = count - 1 + (binary < 0 ? binary : 0); /* of the first digit */
    kept = decimal_round(digits, count, &more);
    exponent += more;
    if (exponent < -4 || exponent >= DECIMAL_DIGITS) {
        *to++ = digits[0];
        if (kept > 1) {
            *to++ = '.';
            to = decimal_copy(to, digits + 1, kept - 1);
        }
        *to++ = 'e';
        *to++ = exponent < 0 ? '-' : '+';
        exponent = exponent < 0 ? -exponent : exponent;
        if (exponent >= 100) {
            *to++ = (char)('0' + exponent / 100);
        }
        *to++ = (char)('0' + exponent / 10 % 10);
        *to++ = (char)('0' + exponent % 10);
    } else {
        if (exponent < 0) {
            to = decimal_copy(to, "0.000", 1 - exponent);
        }
        for (k = 0; k < kept || k <= exponent; k++) {
            if (k > 0 && k == exponent + 1) {
                *to++ = '.';
            }
            *to++ = k < kept ? digits[k] : '0';
        }
    }
    *to = 0;
}

#endif
