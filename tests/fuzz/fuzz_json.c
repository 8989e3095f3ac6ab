/* fuzz_json.c - whatever json_read accepts prints, reads back, and prints the same again; from a
 * pool too, which refuses the rest */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "base/json.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    cJSON *value = NULL, *again = NULL;
    struct json_pool *pool = NULL;
    struct modal_error err;

    if (json_read((const char *)data, size, &value, &err) != MODAL_OK) {
        if (json_read_pooled((const char *)data, size, &value, &pool, &err) == MODAL_OK)
            abort();
        return 0;
    }
    char *first = json_print(value);
    if (first == NULL || json_read(first, strlen(first), &again, &err) != MODAL_OK)
        abort();
    char *second = json_print(again);
    if (second == NULL || strcmp(first, second) != 0)
        abort();
    free(second);
    cJSON_Delete(value);
    cJSON_Delete(again);
    if (json_read_pooled((const char *)data, size, &value, &pool, &err) != MODAL_OK ||
        (second = json_print(value)) == NULL || strcmp(first, second) != 0)
        abort();
    json_pool_free(pool);
    free(first);
    free(second);
    return 0;
}
