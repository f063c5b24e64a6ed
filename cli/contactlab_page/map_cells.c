/* Values, grouped by cell: what `_grouped_by_numpy` in map_cells.py returns, bit by bit, in one pass. */
#include <stdint.h>

static int64_t cell_at(const void* cells, int64_t width, int64_t place) {
  switch (width) {
    case 1: return ((const uint8_t*)cells)[place];
    case 2: return ((const uint16_t*)cells)[place];
    case 4: return ((const uint32_t*)cells)[place];
    default: return ((const int64_t*)cells)[place];
  }
}

/* Args: the cell of each value, in numbers of `width` bytes; `count` values; where the values of
 * each cell start, which moves to where they end; the sum of each cell, zero; room for the values.
 */
void group_by_cell(const void* cells, int64_t width, const double* values, int64_t count,
                   int64_t* starts, double* sums, double* grouped) {
  for (int64_t place = 0; place < count; place++) {
    int64_t cell = cell_at(cells, width, place);
    grouped[starts[cell]++] = values[place];
    sums[cell] += values[place];
  }
}
