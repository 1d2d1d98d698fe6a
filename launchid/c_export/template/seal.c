/* A seal with the words of an array, each turned by its place and mixed anew after as many as a word has bits. */
static int64_t fold_numbers(int64_t before, const double *x, int64_t n)
{
    int64_t seal = before;
    for (int64_t group = 0; group < ((n + 63) / 64); group++) {
        const int64_t end = min_integer(64 * (group + 1), n);
        seal = mixed(seal);
        for (int64_t k = 64 * group; k < end; k++) {
            seal = seal_double(seal, x[k], k);
        }
    }
    return seal;
}

static int64_t fold_counts(int64_t before, const int64_t x[], int64_t n)
{
    int64_t seal = before;
    for (int64_t group = 0; group < ((n + 63) / 64); group++) {
        const int64_t end = min_integer(64 * (group + 1), n);
        seal = mixed(seal);
        for (int64_t k = 64 * group; k < end; k++) {
            seal = seal_integer(seal, x[k], k);
        }
    }
    return seal;
}
