/* fuzz_json.c - whatever json_read accepts prints, reads back, and prints the same again */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "modal/json.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    cJSON *value = NULL, *again = NULL;
    struct modal_error err;

    if (json_read((const char *)data, size, &value, &err) != MODAL_OK)
        return 0;
    char *first = json_print(value);
    if (first == NULL || json_read(first, strlen(first), &again, &err) != MODAL_OK)
        abort();
    char *second = json_print(again);
    if (second == NULL || strcmp(first, second) != 0)
        abort();
    free(first);
    free(second);
    cJSON_Delete(value);
    cJSON_Delete(again);
    return 0;
}
