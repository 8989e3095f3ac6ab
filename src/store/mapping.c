/* mapping.c - see mapping.h */
#include "store/mapping.h"
#include <errno.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

static const uint64_t RESIDENT_MOST = (uint64_t)256 << 20;

static uintptr_t page(void)
{
    return (uintptr_t)sysconf(_SC_PAGESIZE);
}

enum modal_status mapping_open(int fd, const char *path, uint64_t offset, uint64_t length,
                               struct mapping *out, struct modal_error *err)
{
    uint64_t start = offset & ~(uint64_t)(page() - 1);
    /* Not fstat, which a confined worker may not call. */
    const off_t size = lseek(fd, 0, SEEK_END);
    size_t mapped;
    void *base;

    if (size < 0)
        return modal_fail(err, MODAL_IO, "%s: %s", path, strerror(errno));
    if (length == 0 || length > (uint64_t)size || offset > (uint64_t)size - length)
        return modal_fail(err, MODAL_CORRUPT, "%s has %lld bytes, its data "
                          "should lie at %llu .. %llu", path, (long long)size,
                          (unsigned long long)offset, (unsigned long long)(offset + length));
    mapped = (size_t)(offset + length - start);
    base = mmap(NULL, mapped, PROT_READ, MAP_SHARED, fd, (off_t)start);
    if (base == MAP_FAILED)
        return modal_fail(err, errno == ENOMEM ? MODAL_NO_MEMORY : MODAL_IO, "%s: mmap: %s", path,
                          strerror(errno));
    *out = (struct mapping) { (char *)base + (offset - start), (size_t)length, base, mapped,
                              offset };
    return MODAL_OK;
}

void mapping_close(struct mapping *map)
{
    if (map->base != NULL)
        munmap(map->base, map->mapped);
    memset(map, 0, sizeof *map);
}

/* Pages that the neighbours share go as well: they come back.  Advice may be refused, and then
 * nothing is given back. */
void mapping_release(const void *from, size_t bytes)
{
    uintptr_t first = (uintptr_t)from & ~(page() - 1),
              end = ((uintptr_t)from + bytes + page() - 1) & ~(page() - 1);

    madvise((void *)first, end - first, MADV_DONTNEED);
}

uint64_t mapping_resident_most(void)
{
    struct rlimit data;

    if (getrlimit(RLIMIT_DATA, &data) == 0 && data.rlim_cur != RLIM_INFINITY
        && data.rlim_cur / 2 < RESIDENT_MOST)
        return data.rlim_cur / 2;
    return RESIDENT_MOST;
}
