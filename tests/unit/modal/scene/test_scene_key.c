/* test_scene_key.c - every table of a scene's keys: its rows, its examples and what the reader says
 * of them */
#include "check.h"
#include <stdlib.h>
#include "modal/scene/lowering.h"
#include "modal/scene/scene.h"

/* A part made of its rows: what is needed, by its example. */
static cJSON *part_of(const struct scene_table *t)
{
    cJSON *part = cJSON_CreateObject();

    for (int k = 0; t->keys[k] != NULL; k++)
        for (const struct scene_key *key = t->keys[k]; key->name != NULL; key++)
            if (strcmp(key->name, "type") == 0)
                cJSON_AddStringToObject(part, "type", t->name);
            else if (key->needed)
                cJSON_AddItemToObject(part, key->name, cJSON_Parse(key->example));
    return part;
}

static cJSON *part_named(const char *list, const char *name)
{
    struct scene_table t;

    for (int i = 0; scene_tables(i, &t); i++)
        if (strcmp(t.list, list) == 0 && t.name != NULL && strcmp(t.name, name) == 0)
            return part_of(&t);
    fail_msg("no %s %s", list, name);
    return NULL;
}

/* PART of T (which becomes the scene's) in a scene that has what the part asks for. */
static cJSON *scene_with(const struct scene_table *t, cJSON *part)
{
    const char *structure = t->structures != NULL ? t->structures[0] : "chain";
    cJSON *scene, *dof;

    if (t->list[0] == '\0')
        return part;
    scene = cJSON_CreateObject();
    cJSON_AddNumberToObject(scene, "omega", 3);
    if (strcmp(t->list, "excitation") == 0) {            /* whose `frame` only a shaft has */
        structure = "shaft";
        cJSON_AddItemToObject(scene, "time", cJSON_Parse("{\"dt\":0.1,\"duration\":1}"));
        if ((dof = cJSON_GetObjectItem(part, "dof")) != NULL)
            cJSON_SetValuestring(dof, "y1");
    }
    if (strcmp(t->list, "structure") == 0) {
        cJSON_AddItemToObject(scene, "structure", part);
        return scene;
    }
    cJSON_AddItemToObject(scene, "structure", part_named("structure", structure));
    if (strcmp(t->list, "initial") == 0 || strcmp(t->list, "time") == 0) {
        cJSON_AddItemToObject(scene, t->list, part);
        return scene;
    }
    if (strcmp(t->list, "sensors") == 0 && strcmp(structure, "wing") == 0)
        cJSON_AddItemToArray(cJSON_AddArrayToObject(scene, "effects"),
                             part_named("effects", "airloads"));
    cJSON_AddItemToArray(cJSON_AddArrayToObject(scene, t->list), part);
    return scene;
}

/* Lower a scene with PART, both given back; the status, and the error in *ERR. */
static enum modal_status lower_part(const struct scene_table *t, cJSON *part,
                                    struct modal_error *err)
{
    cJSON *scene = scene_with(t, part);
    struct program *p = NULL;
    enum modal_status rc;

    *err = (struct modal_error) { 0 };
    rc = scene_lower(scene, NULL, &p, err);
    program_free(p);
    cJSON_Delete(scene);
    return rc;
}

static const char *called(const struct scene_table *t)
{
    return t->name != NULL ? t->name : t->list;
}

/* Run ON for every row of every table. */
static void each_row(void (*on)(const struct scene_table *, const struct scene_key *))
{
    struct scene_table t;
    int i = 0;

    for (; scene_tables(i, &t); i++)
        for (int k = 0; t.keys[k] != NULL; k++)
            for (const struct scene_key *key = t.keys[k]; key->name != NULL; key++)
                on(&t, key);
    CHECK(i > 3 + 5 + 20 + 6 + 3);  /* the scene's own, structures, effects, excitations, sensors */
}

static bool is_number(const struct scene_key *key)
{
    return key->type == SCENE_NUMBER || key->type == SCENE_WHOLE || key->type == SCENE_NUMBERS;
}

static void check_told(const struct scene_table *t, const struct scene_key *key)
{
    int named = 0;

    if (t->law == NULL || key->means == NULL || (is_number(key) && key->unit == NULL))
        fail_msg("%s.%s is not told", called(t), key->name);
    if (is_number(key) && !(key->low < key->high))
        fail_msg("%s.%s has no range", called(t), key->name);
    if (strcmp(key->name, "type") != 0 && key->example == NULL)
        fail_msg("%s.%s has no example", called(t), key->name);
    for (int k = 0; t->keys[k] != NULL; k++)
        for (const struct scene_key *other = t->keys[k]; other->name != NULL; other++)
            named += strcmp(other->name, key->name) == 0;
    if (named != 1)
        fail_msg("%s.%s stands %d times", called(t), key->name, named);
}

TEST(every_key_is_told_once_with_its_unit_range_law_and_example)
{
    each_row(check_told);
}

static void check_default(const struct scene_table *t, const struct scene_key *key)
{
    int words = 0;

    if (key->needed || key->otherwise != NULL)
        return;
    if ((key->type == SCENE_NUMBER || key->type == SCENE_WHOLE)
        && !(key->standard >= key->low && key->standard <= key->high))
        fail_msg("%s.%s is %g by default, outside [%g, %g]", called(t), key->name, key->standard,
                 key->low, key->high);
    while (key->type == SCENE_WORD && key->words[words] != NULL)
        words++;
    CHECK(key->type != SCENE_WORD || (key->standard >= 0 && key->standard < words));
}

TEST(every_default_is_within_its_range)
{
    each_row(check_default);
}

/* The example in place of what the part needs, or beside it. */
static void check_example(const struct scene_table *t, const struct scene_key *key)
{
    cJSON *part = part_of(t), *value = NULL;
    struct modal_error err;

    if (strcmp(key->name, "direction") == 0)              /* in place of both */
        cJSON_DeleteItemFromObjectCaseSensitive(part, "dof");
    if (strcmp(key->name, "type") != 0) {
        if (json_read(key->example, strlen(key->example), &value, &err) != MODAL_OK)
            fail_msg("%s.%s: %s", called(t), key->name, err.message);
        cJSON_DeleteItemFromObjectCaseSensitive(part, key->name);
        cJSON_AddItemToObject(part, key->name, value);
    }
    for (int k = 0; t->keys[k] != NULL; k++)
        for (const struct scene_key *other = t->keys[k]; other->name != NULL; other++)
            if ((other->with != NULL && strcmp(other->with, key->name) == 0)
                || (strcmp(key->name, "inflow_states") == 0 && strcmp(other->name, "inflow") == 0))
                cJSON_AddItemToObject(part, other->name, cJSON_Parse(other->example));
    if (strcmp(key->name, "file") == 0) {                 /* which clients take away */
        CHECK(lower_part(t, part, &err) == MODAL_BAD_INPUT);
        CHECK_STRING(err.field, "structure.file");
    } else if (lower_part(t, part, &err) != MODAL_OK)
        fail_msg("%s.%s: %s: %s", called(t), key->name, err.field, err.message);
}

TEST(every_example_parses)
{
    each_row(check_example);
}

/* A number outside its range, and no number at all: the message has the path, the value, the unit.
 */
static void check_refusal(const struct scene_table *t, const struct scene_key *key)
{
    cJSON *part = part_of(t);
    struct modal_error err;
    const char *dot;

    if (key->at == SCENE_ELSEWHERE || key->type == SCENE_OWN
        || key->type == SCENE_ENDS || key->type == SCENE_PLACE) {
        cJSON_Delete(part);
        return;
    }
    cJSON_DeleteItemFromObjectCaseSensitive(part, key->name);
    cJSON_AddItemToObject(part, key->name, cJSON_Parse("{\"wrong\":1}"));
    CHECK(lower_part(t, part, &err) == MODAL_BAD_INPUT);
    dot = strrchr(err.field, '.');
    CHECK_STRING(dot != NULL ? dot + 1 : err.field, key->name);
    if (strstr(err.message, "{\"wrong\":1}") == NULL || strstr(err.message, "accepted: ") == NULL ||
        (is_number(key) &&
         (strstr(err.message, key->unit) == NULL || strstr(err.message, key->means) == NULL)))
        fail_msg("%s.%s: %s", called(t), key->name, err.message);
}

TEST(what_is_no_value_of_a_key_is_refused_by_its_name_its_value_and_its_unit)
{
    each_row(check_refusal);
}

/* One letter more is no key, and the message knows which was meant. */
static void check_misspelt(const struct scene_table *t, const struct scene_key *key)
{
    cJSON *part = part_of(t);
    struct modal_error err;
    char wrong[64], meant[96];

    if (strcmp(t->list, "sensors") == 0 && t->structures != NULL &&
        strcmp(t->structures[0], "shaft") == 0)
        cJSON_AddStringToObject(part, "frame", "fixed");  /* without, it is the sensor of any dof */
    snprintf(wrong, sizeof wrong, "%sq", key->name);
    cJSON_AddNullToObject(part, wrong);
    CHECK(lower_part(t, part, &err) == MODAL_BAD_INPUT);
    CHECK(strstr(err.field, wrong) != NULL && strstr(err.message, "accepted: ") != NULL);
    snprintf(meant, sizeof meant, "%s", key->name);
    if (strlen(key->name) >= 2 && strstr(strstr(err.message, "did you mean") != NULL
                                         ? strstr(err.message, "did you mean") : "", meant) == NULL)
        fail_msg("%s.%s: %s", called(t), key->name, err.message);
}

TEST(a_key_with_a_letter_too_many_is_refused_and_the_right_one_named)
{
    each_row(check_misspelt);
}

/* Without it the part is refused at its path, unless the key that stands in for it is there. */
static void check_needed(const struct scene_table *t, const struct scene_key *key)
{
    cJSON *part = part_of(t);
    struct modal_error err;
    const char *dot;

    cJSON_DeleteItemFromObjectCaseSensitive(part, key->name);
    if (!key->needed) {
        cJSON_Delete(part);
        return;
    }
    CHECK(lower_part(t, part, &err) == MODAL_BAD_INPUT);
    if (strstr(err.message, "needs \"dof\", \"station\" or \"position\"") != NULL
        && strstr("station position", key->name) != NULL)
        return;                             /* a wing's sensor is told by which of them it has */
    dot = strrchr(err.field, '.');
    CHECK_STRING(dot != NULL ? dot + 1 : err.field, key->name);
    CHECK(strstr(err.message, "is missing") != NULL && strstr(err.message, key->means) != NULL);
}

TEST(a_needed_key_that_is_missing_is_named_with_what_it_is)
{
    each_row(check_needed);
}
