/* test_workspace.c - memory that is given back at once, and the one failure that it keeps */
#include "check.h"
#include <stdint.h>
#include "modal/linalg/workspace.h"

/* What is too much is refused, under AddressSanitizer as elsewhere. */
const char *__asan_default_options(void);
const char *__asan_default_options(void)
{
    return "allocator_may_return_null=1";
}

TEST(pieces_are_zeros_that_do_not_overlap_and_none_is_null)
{
    struct workspace w = { 0 };
    double *x[100];

    for (int i = 0; i < 100; i++) {                   /* more than the first list has room for */
        x[i] = workspace_zeros(&w, (size_t)i, sizeof *x[i]);
        CHECK(x[i] != NULL);
        for (int j = 0; j < i; j++)
            CHECK(x[i][j] == 0);
        for (int j = 0; j < i; j++)
            x[i][j] = i;
    }
    for (int i = 0; i < 100; i++)
        for (int j = 0; j < i; j++)
            CHECK(x[i][j] == i);
    CHECK(workspace_check(&w, "none", NULL) == MODAL_OK);
    workspace_free(&w);
    CHECK(w.count == 0 && w.held == NULL);
}

TEST(one_refusal_is_told_however_many_pieces_follow_and_gone_once_all_is_freed)
{
    struct workspace w = { 0 };
    struct modal_error err = { 0 };

    CHECK(workspace_zeros(&w, SIZE_MAX / 16, sizeof(double)) == NULL);    /* half of all bytes */
    CHECK(workspace_zeros(&w, 3, sizeof(double)) != NULL);
    CHECK(workspace_check(&w, "beam: no memory", &err) == MODAL_NO_MEMORY);
    CHECK_STRING(err.message, "beam: no memory");
    workspace_free(&w);
    CHECK(workspace_check(&w, "beam: no memory", &err) == MODAL_OK);
}
