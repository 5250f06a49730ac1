/*
 * noslip_version.h - version of this C runtime.
 *
 * Generated headers compile only with a runtime of the same major and minor version.
 */
#ifndef NOSLIP_VERSION_H
#define NOSLIP_VERSION_H

#define NOSLIP_VERSION "0.5.0"
#define NOSLIP_VERSION_NUMBER 500 /* 10000 major + 100 minor + patch */

/* Returns NOSLIP_VERSION of the headers that the caller was compiled with. */
static inline const char *noslip_version(void)
{
    return NOSLIP_VERSION;
}

#endif
