/* test_keyfile.c - a pair of CURVE keys in a file */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "wire/keyfile.h"

/* Of a thousand keys of Z85 a dozen would: all but a hundred-thousandth of runs would see one. */
static void test_no_public_key_looks_like_an_option(void **state)
{
    char folder[] = "/tmp/test_keyfile.XXXXXX", path[64], public[41];
    struct keyfile keys;

    (void)state;
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/key", folder);
    for (int i = 0; i < 1000; i++) {
        assert_int_equal(keyfile_make(path, NULL, public, NULL), MODAL_OK);
        assert_int_not_equal(public[0], '-');
        if (i == 0) {
            assert_int_equal(keyfile_read(path, &keys, NULL), MODAL_OK);
            assert_string_equal(keys.public, public);
        }
        unlink(path);
    }
    rmdir(folder);
}

/* Opening one waits for who writes: the test would not end. */
static void test_a_fifo_is_no_key_file(void **state)
{
    char folder[] = "/tmp/test_keyfile.XXXXXX", path[64];
    struct modal_error err;
    struct keyfile keys;

    (void)state;
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/key", folder);
    assert_int_equal(mkfifo(path, 0600), 0);
    assert_int_equal(keyfile_read(path, &keys, &err), MODAL_BAD_INPUT);
    assert_string_equal(err.field, "keyfile");
    unlink(path);
    rmdir(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_no_public_key_looks_like_an_option),
                                        cmocka_unit_test(test_a_fifo_is_no_key_file) };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
