/* Memory for large arrays in temporary files, for NumPy (NEP 49) and for the contact kernel.
 *
 * A block of at least `most` bytes is a file without a name, so that nothing is left of it however
 * the process ends. Smaller blocks, and all blocks while it is turned off, are of malloc. A thread
 * takes pages from the process when too many are in memory; they stay in the file, and come back
 * when they are used again.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

typedef struct Block Block;
struct Block {
  char* address;
  size_t size; /* bytes, in whole pages */
  Block* next;
};

static pthread_mutex_t guard = PTHREAD_MUTEX_INITIALIZER;
static Block* blocks;       /* in files now */
static char folder[4096];   /* of the files */
static size_t least;        /* bytes of a block that goes to a file; 0 if none does */
static size_t most_resident; /* bytes of all blocks that may be in memory */
static int failed;          /* the last error of a file, or 0 */

static Block** find_block(const void* address) {
  Block** place = &blocks;
  while (*place && (*place)->address != address) {
    place = &(*place)->next;
  }
  return place;
}

static size_t pages_of(size_t size) {
  const size_t page = sysconf(_SC_PAGESIZE);
  return (size + page - 1) / page * page;
}

static int open_file(void) {
#ifdef O_TMPFILE
  int file = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (file >= 0) {
    return file;
  }
#endif
  char name[sizeof folder + 16];
  snprintf(name, sizeof name, "%s/arrayXXXXXX", folder);
  int named = mkstemp(name);
  if (named >= 0) {
    unlink(name);
  }
  return named;
}

/* Return zeros in a new file, or NULL. */
static void* map_block(size_t size) {
  Block* block = malloc(sizeof(Block));
  const size_t whole = pages_of(size);
  const int file = block ? open_file() : -1;
  if (file < 0) {
    failed = errno;
    free(block);
    return NULL;
  }
  /* Without space for all of it, a later write would end the process. */
  void* address = MAP_FAILED;
  int error = posix_fallocate(file, 0, whole);
  if (!error) {
    address = mmap(NULL, whole, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    error = address == MAP_FAILED ? errno : 0;
  }
  close(file);
  if (error) {
    failed = error;
    free(block);
    return NULL;
  }
  pthread_mutex_lock(&guard);
  *block = (Block){address, whole, blocks};
  blocks = block;
  pthread_mutex_unlock(&guard);
  return address;
}

/* Remove a block in a file; return 0 if this is none. */
static int unmap_block(void* address) {
  pthread_mutex_lock(&guard);
  Block** place = find_block(address);
  Block* block = *place;
  if (block) {
    *place = block->next;
    munmap(block->address, block->size);
  }
  pthread_mutex_unlock(&guard);
  free(block);
  return block != NULL;
}

static int goes_to_file(size_t size) {
  return least && size >= least;
}

void* take_memory(void* context, size_t size) {
  (void)context;
  return goes_to_file(size) ? map_block(size) : malloc(size);
}

void* take_zeros(void* context, size_t count, size_t size) {
  (void)context;
  size_t bytes;
  if (__builtin_mul_overflow(count, size, &bytes)) {
    return NULL;
  }
  return goes_to_file(bytes) ? map_block(bytes) : calloc(count, size);
}

void give_memory(void* context, void* address, size_t size) {
  (void)context, (void)size;
  if (address && !unmap_block(address)) {
    free(address);
  }
}

void* change_memory(void* context, void* address, size_t size) {
  pthread_mutex_lock(&guard);
  Block* block = address ? *find_block(address) : NULL;
  const size_t before = block ? block->size : 0;
  pthread_mutex_unlock(&guard);
  if (!before && (address || !goes_to_file(size)) && !goes_to_file(size)) {
    return realloc(address, size);
  }
  void* changed;
  if (before) {
    changed = take_memory(context, size);
    if (changed) {
      memcpy(changed, address, before < size ? before : size);
      unmap_block(address);
    }
    return changed;
  }
  /* The length of a block of malloc is unknown, but it is not longer than a small one. */
  void* grown = realloc(address, size);
  if (!grown) {
    return NULL;
  }
  changed = map_block(size);
  if (changed) {
    memcpy(changed, grown, size);
  }
  free(grown);
  return changed;
}

/* The same for the kernel. */
void* resize_slots(void* address, size_t size) { return change_memory(NULL, address, size); }
void release_slots(void* address) { give_memory(NULL, address, 0); }

/* NumPy's PyDataMem_Handler. */
static struct {
  char name[127];
  uint8_t version;
  void* context;
  void* (*malloc)(void*, size_t);
  void* (*calloc)(void*, size_t, size_t);
  void* (*realloc)(void*, void*, size_t);
  void (*free)(void*, void*, size_t);
} handler = {"contactlab_disk", 1, NULL, take_memory, take_zeros, change_memory, give_memory};

void* numpy_handler(void) { return &handler; }

/* Return the bytes of files in this process' memory. */
static size_t resident_bytes(void) {
  long total = 0, own = 0, shared = 0;
  FILE* file = fopen("/proc/self/statm", "re");
  if (file) {
    if (fscanf(file, "%ld %ld %ld", &total, &own, &shared) != 3) {
      shared = 0;
    }
    fclose(file);
  }
  return (size_t)shared * sysconf(_SC_PAGESIZE);
}

static void* watch_memory(void* unused) {
  (void)unused;
  const struct timespec pause = {0, 2000000};
  const size_t usual = resident_bytes();
  while (1) {
    nanosleep(&pause, NULL);
    if (blocks && resident_bytes() > usual + most_resident) {
      pthread_mutex_lock(&guard);
      for (Block* block = blocks; block; block = block->next) {
        madvise(block->address, block->size, MADV_DONTNEED);
      }
      pthread_mutex_unlock(&guard);
    }
  }
  return NULL;
}

/* Put blocks of at least so many bytes into files from now on; 0 for none. Return an error or 0. */
int use_files(const char* where, size_t from, size_t resident) {
  static pid_t watched; /* a forked process has no such thread */
  snprintf(folder, sizeof folder, "%s", where);
  least = from;
  most_resident = resident;
  failed = 0;
  if (from && watched != getpid()) {
    pthread_t thread;
    int error = pthread_create(&thread, NULL, watch_memory, NULL);
    if (error) {
      return error;
    }
    pthread_detach(thread);
    watched = getpid();
  }
  return 0;
}

/* Return the error of the last file that could not be made; 0 if there was none. */
int last_error(void) { return failed; }
