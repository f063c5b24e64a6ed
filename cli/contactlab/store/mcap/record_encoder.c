/* Fills the Message records of a trace: constant bytes first, then each field from its array.
 *
 * NumPy does the same column by column, in four times the time: it reads and writes each record
 * once a column, and copies three numbers as slowly as a thousand. */
#include <stdint.h>
#include <string.h>

/* Where a field is in a record: `items` parts of so many numbers of a width [bytes].
 *
 * Numbers of four bytes that are `rounded` come from eight. */
typedef struct {
  int64_t start, step, items, numbers, width, rounded;
} Place;

/* Where its values are: those of a state row, and of an item of it. */
typedef struct {
  int64_t address, row, item;
} Source;

static void copy(char* to, const char* from, const Place* place) {
  const int64_t bytes = place->numbers * place->width;
  if (place->rounded) {
    for (int64_t each = 0; each < place->numbers; each++) {
      double number;
      memcpy(&number, from + 8 * each, 8);
      float rounded = (float)number;
      memcpy(to + 4 * each, &rounded, 4);
    }
  } else if (bytes == 8) { /* A constant length needs no call. */
    memcpy(to, from, 8);
  } else {
    memcpy(to, from, bytes);
  }
}

/* Fill records that begin at `starts` (count); `sources` (channels, fields) are by channel. */
void fill_records(char* data, int64_t count, const int64_t* starts, const int64_t* channels,
                  const int64_t* rows, const char* template, int64_t size, const Place* places,
                  const Source* sources, int64_t fields) {
  for (int64_t each = 0; each < count; each++) {
    char* record = data + starts[each];
    const Source* source = sources + channels[each] * fields;
    memcpy(record, template, size);
    for (int64_t field = 0; field < fields; field++, source++) {
      const Place* place = places + field;
      const char* from = (const char*)(intptr_t)source->address + rows[each] * source->row;
      char* to = record + place->start;
      for (int64_t item = 0; item < place->items; item++) {
        copy(to, from, place);
        to += place->step;
        from += source->item;
      }
    }
  }
}
