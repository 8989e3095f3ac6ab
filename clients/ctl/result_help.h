/* result_help.h - results and their diagnostics, told from the rows of result_key.h */
#ifndef CTL_RESULT_HELP_H
#define CTL_RESULT_HELP_H
#include <stdio.h>
#include "base/error.h"

/*
 * Print every result, or what is called WORD: a kind's, every member of that name with its path, a
 * diagnostic code; each with its unit, when it is null or absent, and its meaning.
 * MODAL_BAD_INPUT, field "member": there is none.
 */
enum modal_status result_help(FILE *to, const char *word, struct modal_error *err);
#endif
