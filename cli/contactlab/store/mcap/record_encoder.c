/* Fills the Message records of a trace: constant bytes first, then each field from its array, or
 * from the values of a block.
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

/* Some records of a column, from the lowest bytes of its numbers on; a width that the compiler knows
 * unrolls the inner loop. */
static inline void unpack_column(const uint8_t* bytes, int64_t plane, int64_t count, int width,
                                 uint64_t* sums, char* to, int64_t size) {
  uint64_t change = sums[0], value = sums[1];
  for (int64_t row = 0; row < count; row++, to += size) {
    uint64_t folded = 0;
    for (int byte = 0; byte < width; byte++) {
      folded |= (uint64_t)bytes[byte * plane + row] << (8 * byte);
    }
    change += (folded >> 1) ^ -(folded & 1);
    value += change;
    memcpy(to, &value, width);
  }
  sums[0] = change;
  sums[1] = value;
}

/* Set the numbers of a width at `places` (columns) of records, from their bytes in a block: the
 * lowest of all, column by column, then the next. They are second differences, with signs folded
 * in; `sums` (columns, 2) are zeros. */
void unpack_values(const uint8_t* data, int64_t count, int64_t width, int64_t columns,
                   const int64_t* places, uint64_t* sums, char* records, int64_t size) {
  const int64_t at_once = 256, plane = columns * count; /* Records that stay in the cache. */
  for (int64_t first = 0; first < count; first += at_once) {
    const int64_t rows = count - first < at_once ? count - first : at_once;
    for (int64_t column = 0; column < columns; column++) {
      const uint8_t* bytes = data + column * count + first;
      uint64_t* own = sums + 2 * column;
      char* to = records + first * size + places[column];
      switch (width) {
        case 4: unpack_column(bytes, plane, rows, 4, own, to, size); break;
        case 8: unpack_column(bytes, plane, rows, 8, own, to, size); break;
        default: unpack_column(bytes, plane, rows, (int)width, own, to, size);
      }
    }
  }
}
