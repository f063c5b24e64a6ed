/* Message records, the indexes of chunks and the values of compact blocks, to the bytes that NumPy
 * leaves in `record_encoder.py`.
 *
 * Nothing here knows what a message says: a layout is the bytes that all records share, and where
 * in a record the values of each field go.
 */
#pragma GCC optimize("O3") /* which vectorizes the loops over bytes */
#include <stdint.h>
#include <string.h>

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "files hold numbers as they lie in the memory of a little-endian machine"
#endif

typedef struct { /* Where a field's values go in a record: an array of two axes. */
  int64_t place, count[2], stride[2];
  int64_t size, narrow; /* bytes of a value; whether it is a double that becomes a float */
} Field;

typedef struct { /* Where they come from: an array of runs, rows and the field's axes. */
  const char* values;
  int64_t run, row, stride[2];
} Source;

enum { STRETCH = 16 }; /* records whose values go through together, so that all stay in L1 */

/* Write one value of each record of a stretch, `place` bytes after its start. */
static void write_values(char* const* records, const int64_t* rows, int64_t count,
                         const Field* field, int64_t place, const char* values, int64_t stride) {
  if (field->narrow) {
    for (int64_t each = 0; each < count; each++) {
      double value;
      memcpy(&value, values + rows[each] * stride, sizeof value);
      float rounded = (float)value;
      memcpy(records[each] + place, &rounded, sizeof rounded);
    }
  } else if (field->size == 8) {
    for (int64_t each = 0; each < count; each++) {
      memcpy(records[each] + place, values + rows[each] * stride, 8);
    }
  } else {
    for (int64_t each = 0; each < count; each++) {
      memcpy(records[each] + place, values + rows[each] * stride, field->size);
    }
  }
}

/* Write all values of a field. */
static void write_field(char* const* records, const int64_t* rows, int64_t count,
                        const Field* field, const Source* source, int64_t run) {
  const char* values = source->values + run * source->run;
  for (int64_t line = 0; line < field->count[0]; line++) {
    for (int64_t each = 0; each < field->count[1]; each++) {
      int64_t place = field->place + line * field->stride[0] + each * field->stride[1];
      const char* first = values + line * source->stride[0] + each * source->stride[1];
      write_values(records, rows, count, field, place, first, source->row);
    }
  }
}

/* Write what one run says in so many rows: the template at each start, and the values over it. */
void write_records(const char* template, int64_t size, const Field* fields, const Source* sources,
                   int64_t count, int64_t run, const int64_t* rows, int64_t records, char* data,
                   const char* starts, int64_t step) {
  char* targets[STRETCH];
  for (int64_t first = 0; first < records; first += STRETCH) {
    int64_t length = records - first < STRETCH ? records - first : STRETCH;
    for (int64_t each = 0; each < length; each++) {
      int64_t start;
      memcpy(&start, starts + (first + each) * step, sizeof start);
      targets[each] = data + start;
      memcpy(targets[each], template, size);
    }
    for (int64_t each = 0; each < count; each++) {
      write_field(targets, rows + first, length, fields + each, sources + each, run);
    }
  }
}

static char* put(char* target, uint64_t number, int size) {
  memcpy(target, &number, size);
  return target + size;
}

/* Write a MessageIndex record for each channel that has messages in a chunk, and its length.
 *
 * Sizes and offsets are (rows, channels); offsets count from the start of another chunk. */
void write_indexes(const uint64_t* times, const int64_t* sizes, const int64_t* offsets,
                   int64_t rows, int64_t channels, char* indexes, int64_t* lengths) {
  enum { OPCODE = 7, HEAD = 15, ENTRY = 16 };
  for (int64_t channel = 0; channel < channels; channel++) {
    char *start = indexes, *entry = indexes + HEAD;
    for (int64_t row = 0; row < rows; row++) {
      if (sizes[row * channels + channel]) {
        entry = put(entry, times[row], 8);
        entry = put(entry, offsets[row * channels + channel] - offsets[0], 8);
      }
    }
    int64_t bytes = entry - start - HEAD;
    lengths[channel] = bytes ? HEAD + bytes : 0;
    if (bytes) {
      char* head = put(start, OPCODE, 1);
      head = put(head, HEAD - 9 + bytes, 8);
      head = put(head, channel + 1, 2);
      put(head, bytes, 4);
      indexes = entry;
    }
  }
}

enum { LINES = 32 };

/* Define a function that writes the planes of columns of so wide a type; see `write_planes`.
 *
 * A stretch of records at a time: their values, the second differences of these with the sign
 * folded into the lowest bit, and the bytes of that. */
#define DEFINE_PLANES(NAME, TYPE)                                                              \
  static void NAME(const char* records, int64_t count, int64_t size, const int64_t* places,    \
                   int64_t columns, uint8_t* planes) {                                         \
    TYPE values[LINES + 2], folded[LINES];                                                     \
    for (int64_t first = 0; first < count; first += LINES) {                                   \
      int64_t length = count - first < LINES ? count - first : LINES;                          \
      for (int64_t column = 0; column < columns; column++) {                                   \
        const char* value = records + first * size + places[column];                           \
        values[0] = values[1] = 0;                                                             \
        for (int64_t each = first ? -2 : 0; each < length; each++) {                           \
          memcpy(values + each + 2, value + each * size, sizeof(TYPE));                        \
        }                                                                                      \
        for (int64_t each = 0; each < length; each++) {                                        \
          TYPE second = (TYPE)(values[each + 2] - 2 * values[each + 1] + values[each]);        \
          TYPE sign = (TYPE)(second >> (8 * sizeof(TYPE) - 1));                                \
          folded[each] = (TYPE)(second << 1 ^ (0 - sign));                                     \
        }                                                                                      \
        for (size_t byte = 0; byte < sizeof(TYPE); byte++) {                                   \
          uint8_t* plane = planes + ((int64_t)byte * columns + column) * count + first;        \
          for (int64_t each = 0; each < length; each++) {                                      \
            plane[each] = (uint8_t)(folded[each] >> 8 * byte);                                 \
          }                                                                                    \
        }                                                                                      \
      }                                                                                        \
    }                                                                                          \
  }

DEFINE_PLANES(planes_of_8, uint64_t)
DEFINE_PLANES(planes_of_4, uint32_t)
DEFINE_PLANES(planes_of_2, uint16_t)
DEFINE_PLANES(planes_of_1, uint8_t)

/* Write the planes of the values of one width, which start at these places in each record. */
void write_planes(const char* records, int64_t count, int64_t size, const int64_t* places,
                  int64_t columns, int64_t width, uint8_t* planes) {
  (width == 8   ? planes_of_8
   : width == 4 ? planes_of_4
   : width == 2 ? planes_of_2
                : planes_of_1)(records, count, size, places, columns, planes);
}
