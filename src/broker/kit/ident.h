/* ident.h - identifiers on the wire: numbers as texts that tell nothing about them */
#ifndef BROKER_IDENT_H
#define BROKER_IDENT_H
#include <stdint.h>

enum { IDENT_TEXT = 9 };          /* 8 letters or digits, 5 bits each, and the end */

/* NUMBER, below 2^40, mixed by SECRET. */
void ident_text(char out[IDENT_TEXT], uint64_t secret, int64_t number);
/* The number of TEXT; -1: it is no identifier. */
int64_t ident_number(uint64_t secret, const char *text);
#endif
