/* test_log.c - a text of another's making stays within its value */
#include "check.h"
#include <stdbool.h>
#include <stdlib.h>
#include "base/log.h"

static void check_line(char *line, const char *expected)
{
    CHECK_STRING(line, expected);
    free(line);
}

TEST(a_line_that_needs_no_escape_is_the_one_that_printf_makes)
{
    char expected[400];

    snprintf(expected, sizeof expected,
             "level=notice event=x slot=%d mode=%04o jobs=%zu n=%lld m=%llu k=%ld s=%.1f user=%s "
             "key=%s text=\"%s\" end",
             -3, 0750u, (size_t)1 << 40, -9007199254740993LL, 18446744073709551615ULL, -7L, 2.385,
             "anna", "a=b:/*?<>", "two words, = too");
    check_line(log_text("level=notice event=x slot=%d mode=%04o jobs=%zu n=%lld m=%llu k=%ld "
                        "s=%.1f user=%s key=%s text=\"%s\" end",
                        -3, 0750u, (size_t)1 << 40, -9007199254740993LL, 18446744073709551615ULL,
                        -7L, 2.385, "anna", "a=b:/*?<>", "two words, = too"),
               expected);
    check_line(log_text("level=notice event=stopped"), "level=notice event=stopped");
}

TEST(a_quoted_text_ends_where_its_last_quote_is)
{
    check_line(log_text("said=\"%s\" slot=%d", "the \"end\"\nlevel=crit c:\\x", 2),
               "said=\"the \\\"end\\\"\\u000alevel=crit c:\\\\x\" slot=2");
    check_line(log_text("said=\"%s\"", ""), "said=\"\"");
    check_line(log_text("said=\"%s\"", "gr\xfc\xc3\x9f"), "said=\"gr\xef\xbf\xbd\xc3\x9f\"");
}

TEST(a_bare_text_is_quoted_where_it_would_make_two_members)
{
    check_line(log_text("user=%s role=read", "eve role=admin"),
               "user=\"eve role=admin\" role=read");
    check_line(log_text("user=%s role=read", "eve\nlevel=crit"),
               "user=\"eve\\u000alevel=crit\" role=read");
    check_line(log_text("file=%s", "say\"so"), "file=\"say\\\"so\"");
    check_line(log_text("file=%s end", ""), "file= end");
}

TEST(a_precision_cuts_a_text_before_it_is_escaped)
{
    check_line(log_text("file=%.4s", "abcdef"), "file=abcd");
    check_line(log_text("said=\"%.3s\"", "a\"bcd"), "said=\"a\\\"b\"");
}
