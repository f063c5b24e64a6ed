/* Checks the Message records of a chunk in one pass, while the chunk is in the cache.
 *
 * NumPy does the same chunk by chunk, in several passes over copies of the records. */
#include <stdint.h>
#include <string.h>

enum { HEADER = 31, FRAME = 9, MESSAGE = 5, ENTRY = 16, STATE_CHANNEL = 1 };

/* Results; a length without a layout is returned as its negative offset, minus one. */
enum { SOUND, CUT, MISPLACED, UNORDERED, DIFFERENT };

/* A channel's index in a chunk, how many of its entries were compared, and the kind of its records;
 * records of kind 0 have no layout. */
typedef struct {
  const char* entries;
  int64_t count, compared, kind;
} Channel;

/* Constant bytes of the records of one kind and length, a mask of them, and records compared. */
typedef struct {
  int64_t kind, size;
  const char *constant, *mask;
  int64_t compared;
} Layout;

/* Bytes of a state record that belong to the states. */
typedef struct {
  int64_t start, bytes;
} Span;

static int differs(const char* record, const Layout* layout) {
  uint64_t difference = 0, bytes[3];
  int64_t at = 0;
  for (; at + 8 <= layout->size; at += 8) {
    memcpy(bytes, record + at, 8);
    memcpy(bytes + 1, layout->constant + at, 8);
    memcpy(bytes + 2, layout->mask + at, 8);
    difference |= (bytes[0] ^ bytes[1]) & bytes[2];
  }
  for (; at < layout->size; at++)
    difference |= (uint8_t)((record[at] ^ layout->constant[at]) & layout->mask[at]);
  return difference != 0;
}

/* Compare a chunk with its channels' indexes (by id from 1) and its layouts; copy its states. */
int64_t check_chunk(const char* data, int64_t size, Channel* channels, int64_t channel_count,
                    Layout* layouts, int64_t layout_count, const Span* spans, int64_t span_count,
                    char* states) {
  uint64_t time = 0, length, times[2], entry[2];
  uint16_t channel, before = 0;
  uint32_t sequence;
  for (int64_t at = 0; at < size;) {
    const char* record = data + at;
    if (size - at < HEADER) return CUT;
    memcpy(&length, record + 1, 8);
    if (length < HEADER - FRAME || length > (uint64_t)(size - at - FRAME)) return CUT;
    const int64_t whole = (int64_t)length + FRAME;
    memcpy(&channel, record + 9, 2);
    memcpy(&sequence, record + 11, 4);
    memcpy(times, record + 15, 16);
    if (record[0] != MESSAGE || channel < 1 || channel > channel_count) return MISPLACED;
    Channel* own = channels + channel - 1;
    if (own->compared == own->count) return MISPLACED;
    memcpy(entry, own->entries + ENTRY * own->compared++, ENTRY);
    if (entry[0] != times[0] || entry[1] != (uint64_t)at) return MISPLACED;
    if (sequence || times[1] != times[0]) return DIFFERENT;
    /* Each time begins with its state; the other channels follow in the order of their ids. */
    if (channel == STATE_CHANNEL ? at && times[0] <= time
                                 : !at || channel <= before || times[0] != time)
      return UNORDERED;
    time = times[0];
    before = channel;
    if (own->kind) {
      Layout* layout = layouts;
      const Layout* const end = layouts + layout_count;
      while (layout < end && (layout->size != whole || layout->kind != own->kind)) layout++;
      if (layout == end) return -at - 1;
      if (differs(record, layout)) return DIFFERENT;
      layout->compared++;
      for (int64_t span = 0; channel == STATE_CHANNEL && span < span_count; span++) {
        memcpy(states, record + spans[span].start, spans[span].bytes);
        states += spans[span].bytes;
      }
    }
    at += whole;
  }
  for (int64_t each = 0; each < channel_count; each++)
    if (channels[each].compared != channels[each].count) return MISPLACED;
  return SOUND;
}
