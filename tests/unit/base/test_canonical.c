/* test_canonical.c - one text for values that differ only in the order of their members */
#include "check.h"
#include <stdbool.h>
#include <stdlib.h>
#include "base/canonical.h"

static char *canonical_of(const char *json)
{
    cJSON *value = cJSON_Parse(json);
    char *text = canonical_text(value);

    cJSON_Delete(value);
    return text;
}

static bool becomes(const char *json, const char *expected)
{
    char *text = canonical_of(json);
    bool same = strcmp(text, expected) == 0;

    free(text);
    return same;
}

TEST(members_stand_in_the_order_of_their_names_at_every_depth)
{
    static const char text[] =
        "{\"B\":[{\"x\":1,\"y\":{\"p\":null,\"q\":\"s\"}},2],\"a\":true,\"ab\":0.1}";

    CHECK(becomes(text, text));
    CHECK(becomes("{\"ab\":0.1,\"a\":true,\"B\":[{\"y\":{\"q\":\"s\",\"p\":null},\"x\":1},2]}",
                  text));
    CHECK(becomes("{\"a\":true,\"B\":[{\"y\":{\"q\":\"s\",\"p\":null},\"x\":1},2],\"ab\":0.1}",
                  text));
}

TEST(elements_of_a_list_stay_where_they_are)
{
    CHECK(becomes("[3,1,2]", "[3,1,2]"));
    CHECK(becomes("{\"b\":[3,1,2],\"a\":[]}", "{\"a\":[],\"b\":[3,1,2]}"));
}

TEST(nothing_is_the_empty_object)
{
    char *text = canonical_text(NULL);

    CHECK_STRING(text, "{}");
    free(text);
    CHECK(becomes("{}", "{}"));
}

static int left;        /* allocations of cJSON that succeed */

static void *failing(size_t size)
{
    return left-- > 0 ? malloc(size) : NULL;
}

/* The copy takes an allocation an item, name and text: each is made to fail once. */
TEST(a_text_is_whole_or_there_is_none)
{
    cJSON *value = cJSON_Parse("{\"b\":{\"d\":\"text\",\"c\":[1,{}]},\"a\":1}");
    int refused = 0;
    char *text = NULL;

    for (; text == NULL && refused < 100; refused++) {
        left = refused;
        cJSON_InitHooks(&(cJSON_Hooks) { .malloc_fn = failing, .free_fn = free });
        text = canonical_text(value);
        cJSON_InitHooks(NULL);
    }
    CHECK_STRING(text, "{\"a\":1,\"b\":{\"c\":[1,{}],\"d\":\"text\"}}");
    CHECK(refused > 7);                     /* as many as there are items at least */
    free(text);
    cJSON_Delete(value);
}
