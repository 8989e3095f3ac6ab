/* crc32c.h - the cyclic redundancy check of chunks: CRC-32C (Castagnoli, reflected, as in iSCSI,
 * RFC 3720 B.4) */
#ifndef BASE_CRC32C_H
#define BASE_CRC32C_H
#include <stddef.h>
#include <stdint.h>

/* The check of CRC's data followed by DATA; start from 0.  crc32c(0, "123456789", 9) is
 * 0xe3069283. */
uint32_t crc32c(uint32_t crc, const void *data, size_t length);

/* The check of a text whose first part has check FIRST and whose second part, of LENGTH bytes, has
 * check SECOND. */
uint32_t crc32c_join(uint32_t first, uint32_t second, uint64_t length);

/* The same without the processor's instruction: what crc32c falls back to. */
uint32_t crc32c_table(uint32_t crc, const void *data, size_t length);
#endif
