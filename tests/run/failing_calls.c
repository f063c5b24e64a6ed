/* Preloaded: the calls by which a process changes files below a place, one of which can fail.
 *
 * Such a call is a point. `watch` counts them, and has one fail: once, with an input/output error
 * before anything is done; from then on, as on a disk that is full, after half of a write; or by
 * SIGKILL, likewise after half of a write. A descriptor is followed from its opening to its close.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum how { COUNT, ERROR, FULL, KILL };
enum call { OPEN, WRITE, SYNC, RENAME, REMOVE, MAKE, CLOSE, TRUNCATE };
enum { MOST_FILES = 1 << 16, MOST_POINTS = 1 << 16 };

static char place[PATH_MAX];
static long wanted, reached;
static enum how manner;
static unsigned char calls[MOST_POINTS];
static char followed[MOST_FILES];
static pthread_mutex_t turn = PTHREAD_MUTEX_INITIALIZER;

void watch(const char *below, long point, int how) {
    snprintf(place, sizeof place, "%s", below);
    wanted = point, manner = how, reached = 0;
}

long points(void) { return reached; }

int call_at(long point) { return calls[point]; }

/* Return 0 if a call goes on, else -1 with errno set; `half` is done before a disk is full. */
static int pass(enum call call, void (*half)(void *), void *of) {
    pthread_mutex_lock(&turn);
    long at = reached++;
    if (at < MOST_POINTS) calls[at] = call;
    int due = manner != COUNT && at == wanted, over = manner == FULL && at > wanted, error = 0;
    int takes_space = call == OPEN || call == WRITE || call == MAKE;
    if (due && manner == KILL) {
        if (half) half(of);
        kill(getpid(), SIGKILL);
    }
    if (due && manner == ERROR) error = EIO;
    if ((due || over) && manner == FULL && takes_space) {
        if (due && half) half(of);
        error = ENOSPC;
    }
    pthread_mutex_unlock(&turn);
    errno = error;
    return error ? -1 : 0;
}

static int is_below(int folder, const char *path) {
    if (!place[0]) return 0;
    if (path[0] == '/' ) return strstr(path, place) != NULL;
    if (folder == AT_FDCWD) return 0;
    char link[64], whole[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
    ssize_t size = readlink(link, whole, sizeof whole - 1);
    if (size < 0) return 0;
    whole[size] = 0;
    return strstr(whole, place) != NULL;
}

static int is_followed(int file) { return place[0] && file >= 0 && file < MOST_FILES && followed[file]; }

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

static int opened(int (*open_at)(int, const char *, int, ...), int folder, const char *path,
                  int flags, mode_t mode) {
    int writes = (flags & O_ACCMODE) != O_RDONLY && is_below(folder, path);
    if (writes && pass(OPEN, NULL, NULL)) return -1;
    int file = open_at(folder, path, flags, mode);
    if (file >= 0 && file < MOST_FILES) followed[file] = writes ? 1 : 0;
    return file;
}

#define MODE(flags) \
    mode_t mode = 0; \
    if ((flags) & (O_CREAT | O_TMPFILE)) { \
        va_list rest; \
        va_start(rest, flags); \
        mode = va_arg(rest, mode_t); \
        va_end(rest); \
    }

int open(const char *path, int flags, ...) { MODE(flags) return opened(NEXT(openat), AT_FDCWD, path, flags, mode); }
int open64(const char *path, int flags, ...) { MODE(flags) return opened(NEXT(openat64), AT_FDCWD, path, flags, mode); }
int openat(int folder, const char *path, int flags, ...) { MODE(flags) return opened(NEXT(openat), folder, path, flags, mode); }
int openat64(int folder, const char *path, int flags, ...) { MODE(flags) return opened(NEXT(openat64), folder, path, flags, mode); }

struct part { int file; const void *data; size_t size; off_t offset; };

static void write_half(void *of) {
    struct part *part = of;
    ssize_t done = part->offset < 0 ? NEXT(write)(part->file, part->data, part->size / 2)
                                    : NEXT(pwrite)(part->file, part->data, part->size / 2, part->offset);
    (void)done;
}

ssize_t write(int file, const void *data, size_t size) {
    struct part part = {file, data, size, -1};
    if (is_followed(file) && pass(WRITE, write_half, &part)) return -1;
    return NEXT(write)(file, data, size);
}

ssize_t pwrite(int file, const void *data, size_t size, off_t offset) {
    struct part part = {file, data, size, offset};
    if (is_followed(file) && pass(WRITE, write_half, &part)) return -1;
    return NEXT(pwrite)(file, data, size, offset);
}

ssize_t pwrite64(int file, const void *data, size_t size, off64_t offset) { return pwrite(file, data, size, offset); }

ssize_t writev(int file, const struct iovec *parts, int count) {
    struct part part = {file, parts[0].iov_base, parts[0].iov_len, -1};
    if (is_followed(file) && pass(WRITE, write_half, &part)) return -1;
    return NEXT(writev)(file, parts, count);
}

ssize_t sendfile(int target, int source, off_t *offset, size_t size) {
    if (is_followed(target) && pass(WRITE, NULL, NULL)) return -1;
    return NEXT(sendfile)(target, source, offset, size);
}

ssize_t sendfile64(int target, int source, off64_t *offset, size_t size) {
    if (is_followed(target) && pass(WRITE, NULL, NULL)) return -1;
    return NEXT(sendfile64)(target, source, offset, size);
}

ssize_t copy_file_range(int source, off64_t *from, int target, off64_t *to, size_t size, unsigned flags) {
    if (is_followed(target) && pass(WRITE, NULL, NULL)) return -1;
    return NEXT(copy_file_range)(source, from, target, to, size, flags);
}

int ftruncate(int file, off_t size) {
    if (is_followed(file) && pass(TRUNCATE, NULL, NULL)) return -1;
    return NEXT(ftruncate)(file, size);
}

int ftruncate64(int file, off64_t size) { return ftruncate(file, size); }

int truncate(const char *path, off_t size) {
    if (is_below(AT_FDCWD, path) && pass(TRUNCATE, NULL, NULL)) return -1;
    return NEXT(truncate)(path, size);
}

int truncate64(const char *path, off64_t size) { return truncate(path, size); }

/* What is synced is opened for reading alone. */
static int is_of_place(int file) { return is_followed(file) || (place[0] && is_below(file, ".")); }

int fsync(int file) {
    if (is_of_place(file) && pass(SYNC, NULL, NULL)) return -1;
    return NEXT(fsync)(file);
}

int fdatasync(int file) {
    if (is_of_place(file) && pass(SYNC, NULL, NULL)) return -1;
    return NEXT(fdatasync)(file);
}

int syncfs(int file) {
    if (is_of_place(file) && pass(SYNC, NULL, NULL)) return -1;
    return NEXT(syncfs)(file);
}

int rename(const char *old, const char *new) {
    if (is_below(AT_FDCWD, new) && pass(RENAME, NULL, NULL)) return -1;
    return NEXT(rename)(old, new);
}

int renameat(int before, const char *old, int after, const char *new) {
    if (is_below(after, new) && pass(RENAME, NULL, NULL)) return -1;
    return NEXT(renameat)(before, old, after, new);
}

int renameat2(int before, const char *old, int after, const char *new, unsigned flags) {
    if (is_below(after, new) && pass(RENAME, NULL, NULL)) return -1;
    return NEXT(renameat2)(before, old, after, new, flags);
}

int unlink(const char *path) {
    if (is_below(AT_FDCWD, path) && pass(REMOVE, NULL, NULL)) return -1;
    return NEXT(unlink)(path);
}

int unlinkat(int folder, const char *path, int flags) {
    if (is_below(folder, path) && pass(REMOVE, NULL, NULL)) return -1;
    return NEXT(unlinkat)(folder, path, flags);
}

int rmdir(const char *path) {
    if (is_below(AT_FDCWD, path) && pass(REMOVE, NULL, NULL)) return -1;
    return NEXT(rmdir)(path);
}

int remove(const char *path) {
    if (is_below(AT_FDCWD, path) && pass(REMOVE, NULL, NULL)) return -1;
    return NEXT(remove)(path);
}

int mkdir(const char *path, mode_t mode) {
    if (is_below(AT_FDCWD, path) && pass(MAKE, NULL, NULL)) return -1;
    return NEXT(mkdir)(path, mode);
}

int mkdirat(int folder, const char *path, mode_t mode) {
    if (is_below(folder, path) && pass(MAKE, NULL, NULL)) return -1;
    return NEXT(mkdirat)(folder, path, mode);
}

/* The descriptor is gone whatever close returns. */
int close(int file) {
    int fails = is_followed(file) && pass(CLOSE, NULL, NULL), error = errno;
    if (file >= 0 && file < MOST_FILES) followed[file] = 0;
    int done = NEXT(close)(file);
    if (!fails) return done;
    errno = error;
    return -1;
}
