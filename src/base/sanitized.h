/* sanitized.h - is this build watched by a sanitizer, which makes calls of its own? */
#ifndef BASE_SANITIZED_H
#define BASE_SANITIZED_H

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1    /* by gcc */
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) \
    || __has_feature(memory_sanitizer)
#define SANITIZED 1    /* by clang */
#endif
#endif
#ifndef SANITIZED
#define SANITIZED 0    /* by none */
#endif

#endif
