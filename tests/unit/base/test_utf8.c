/* test_utf8.c - malformed sequences of RFC 3629 are found; what is not UTF-8 is taken for Latin-1
 */
#include "check.h"
#include <stdlib.h>
#include "base/utf8.h"

TEST(a_sequence_has_the_length_its_first_byte_says)
{
    static const char *const good[] = { "a", "\xc2\x80", "\xe2\x82\xac", "\xf4\x8f\xbf\xbf" };

    for (int n = 0; n < 4; n++)
        CHECK(utf8_length(good[n], good[n] + n + 1) == n + 1);
}

/* Alone, overlong (2, 3, 4 bytes), a surrogate, past U+10FFFF, an unused first byte, cut. */
TEST(a_malformed_sequence_has_no_length)
{
    static const char *const bad[] = { "\x80",         "\xc1\xbf",
                                       "\xe0\x9f\xbf", "\xf0\x8f\xbf\xbf",
                                       "\xed\xa0\x80", "\xf4\x90\x80\x80",
                                       "\xff",         "\xe2\x82" };

    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        CHECK(utf8_length(bad[i], bad[i] + strlen(bad[i])) == 0);
        CHECK(!utf8_valid(bad[i]));
    }
}

/* Unicode's category Cc, and UAX #9's marks, embeddings, overrides and isolates. */
TEST(control_characters_are_those_of_category_cc_and_of_direction_and_no_others)
{
    static const struct { const char *text; int at; } cases[] = {
        { "", 0 },           { "a b", 3 },        { "a\x1f", 1 },       { "\x7f", 0 },
        { "ab\xc2\x80", 2 },  { "\xc2\x9b" "31m", 0 }, { "x\xc2\x9f", 1 }, { "\xc2\xa0", 2 },
        { "\xc3\x9b", 2 },   { "\xe2\x82\x9b", 3 }, { "a\nb", 1 },
        { "a\xe2\x80\xae", 1 },      /* U+202E */
        { "\xe2\x80\x8e", 0 },       /* U+200E */
        { "\xe2\x81\xa9", 0 },       /* U+2069 */
        { "\xd8\x9c", 0 },           /* U+061C */
        { "\xe2\x80\x8d", 3 },       /* U+200D, the joiner of emoji */
        { "\xe2\x80\xa9\xe2\x81\xa5", 6 } };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        CHECK(utf8_control(cases[i].text) == cases[i].text + cases[i].at);
}

static char *put(const char *text, size_t length, size_t done)
{
    char *out = NULL;
    size_t size;
    FILE *file = open_memstream(&out, &size);

    CHECK(utf8_put(file, text, length) == done);
    fclose(file);
    return out;
}

TEST(what_is_put_for_people_has_no_control_character_but_ends_of_lines_and_tabs)
{
    static const char text[] = "a\x1b[31m\tb\r\n\xc2\x9b" "1m\xe2\x80\xaex\xff\xc3\xbc"
                               "\0\x7f";
    char *out = put(text, sizeof text - 1, sizeof text - 1);

    CHECK_STRING(out, "a\\u001b[31m\tb\\u000d\n\\u009b1m\\u202ex\xef\xbf\xbd\xc3\xbc"
                 "\\u0000\\u007f");
    free(out);
    out = put("ab\xe2\x80", 4, 2);               /* cut: the caller puts it with what follows */
    CHECK_STRING(out, "ab");
    free(out);
}

TEST(bytes_become_utf8_and_end_at_the_first_zero)
{
    char *same = utf8_from("gr\xc3\xbc\xc3\x9f", 7), *latin = utf8_from("gr\xfc\xdf", 4),
         *cut = utf8_from("ab\0cd", 5);

    CHECK_STRING(same, "gr\xc3\xbc\xc3\x9f");
    CHECK_STRING(latin, "gr\xc3\xbc\xc3\x9f");
    CHECK_STRING(cut, "ab");
    free(same);
    free(latin);
    free(cut);
}
