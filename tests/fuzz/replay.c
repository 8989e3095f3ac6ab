/*
 * replay.c - what runs a fuzz target where libFuzzer is not: the kept inputs, then changes of them
 *
 * `fuzz_NAME SECONDS LAST FOLDER`: every file of FOLDER as it is, then inputs made of them by a
 * fixed generator until SECONDS are over, alike each time.  The input that runs stands in LAST, so
 * what ended the program is found there; of what leaks, the one before the leak was looked for.
 */
#include <dirent.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/lsan_interface.h>
#else
static int __lsan_do_recoverable_leak_check(void) { return 0; }
#endif

/* LEAKS_EVERY: what a leak check takes, 10 ms and more, is little beside so many runs of 0.1 ms. */
enum { LENGTH_MOST = 1 << 16, INPUTS_MOST = 4096, CHANGES_MOST = 8, LEAKS_EVERY = 1000 };

struct input {
    uint8_t *data;
    size_t size;
};

static struct input kept[INPUTS_MOST];
static int kept_count;
static uint64_t state = 1;

/* Xorshift64*. */
static size_t below(size_t limit)
{
    state ^= state >> 12, state ^= state << 25, state ^= state >> 27;
    return limit > 0 ? (size_t)((state * 0x2545F4914F6CDD1D) >> 32) % limit : 0;
}

static int by_name(const struct dirent **a, const struct dirent **b)
{
    return strcmp((*a)->d_name, (*b)->d_name);
}

static void keep(const char *folder, const char *name)
{
    static uint8_t data[LENGTH_MOST];
    struct input *in = &kept[kept_count];
    char path[4096];
    FILE *file;

    snprintf(path, sizeof path, "%s/%s", folder, name);
    if (name[0] == '.')
        return;
    if (kept_count == INPUTS_MOST || (file = fopen(path, "rb")) == NULL) {
        fprintf(stderr, "%s: cannot be read, or there are more than %d\n", path, INPUTS_MOST);
        exit(2);
    }
    in->size = fread(data, 1, sizeof data, file);
    if (in->size == sizeof data) {
        fprintf(stderr, "%s: %d bytes or more\n", path, LENGTH_MOST);
        exit(2);
    }
    in->data = memcpy(malloc(in->size + 1), data, in->size);
    kept_count++;
    fclose(file);
}

/* One change of SIZE bytes at DATA, which has room for LENGTH_MOST; the size after it. */
static size_t change(uint8_t *data, size_t size)
{
    const struct input *other = &kept[below((size_t)kept_count)];
    size_t at = below(size), from = below(other->size), length = below(other->size - from) + 1;

    switch (below(5)) {
    case 0:                                                 /* a bit */
        if (size > 0)
            data[at] ^= (uint8_t)(1u << below(8));
        return size;
    case 1:                                                 /* a byte */
        if (size > 0)
            data[at] = (uint8_t)below(256);
        return size;
    case 2:                                                 /* its end is cut */
        return at;
    case 3:                                                 /* a piece is gone */
        length = below(size - at) + (size > 0);
        memmove(data + at, data + at + length, size - at - length);
        return size - length;
    default:                                                /* a piece of another comes in */
        if (other->size == 0 || size + length > LENGTH_MOST)
            return size;
        memmove(data + at + length, data + at, size - at);
        memcpy(data + at, other->data + from, length);
        return size + length;
    }
}

/* Of what stands behind the input, the target sees nothing: its copy ends where the input does. */
static void run(const uint8_t *data, size_t size, uint8_t *last, int file)
{
    uint8_t *copy = malloc(size > 0 ? size : 1);

    if (ftruncate(file, (off_t)size) != 0)
        abort();
    memcpy(last, data, size);
    memcpy(copy, data, size);
    LLVMFuzzerTestOneInput(copy, size);
    free(copy);
}

int main(int argc, char **argv)
{
    static uint8_t data[LENGTH_MOST];
    struct dirent **names;
    struct timespec begun, now;
    uint8_t *last;
    long runs = 0;
    int file, count;

    if (argc != 4 || (count = scandir(argv[3], &names, NULL, by_name)) < 0
        || (file = open(argv[2], O_RDWR | O_CREAT | O_TRUNC, 0600)) < 0) {
        fprintf(stderr, "usage: %s SECONDS LAST FOLDER\n", argv[0]);
        return 2;
    }
    last = mmap(NULL, LENGTH_MOST, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    for (int i = 0; i < count; free(names[i++]))
        keep(argv[3], names[i]->d_name);
    free(names);
    if (kept_count == 0 || last == MAP_FAILED)
        return 2;
    for (; runs < kept_count; runs++)
        run(kept[runs].data, kept[runs].size, last, file);
    clock_gettime(CLOCK_MONOTONIC, &begun);
    do {
        const struct input *from = &kept[below((size_t)kept_count)];
        size_t size = from->size;
        memcpy(data, from->data, size);
        for (size_t changes = 1 + below(CHANGES_MOST); changes > 0; changes--)
            size = change(data, size);
        run(data, size, last, file);
        if (++runs % LEAKS_EVERY == 0 && __lsan_do_recoverable_leak_check() != 0)
            return 1;
        clock_gettime(CLOCK_MONOTONIC, &now);
    } while (now.tv_sec - begun.tv_sec < atol(argv[1]));
    for (int i = 0; i < kept_count; i++)
        free(kept[i].data);
    if (__lsan_do_recoverable_leak_check() != 0)
        return 1;
    munmap(last, LENGTH_MOST), close(file), unlink(argv[2]);
    printf("number_of_executed_units: %ld\n", runs);
    return 0;
}
