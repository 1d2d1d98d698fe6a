/* A seal with the words of an array, each turned by its place and mixed anew after as many as a word has bits. */
static int64_t fold_numbers(int64_t before, const double *x, int64_t n)
{
    int64_t seal = before;
    for (int64_t k = 0; k < n; k++) {
        if (((uint64_t)k & 63U) == 0U) {
            seal = mixed(seal);
        }
        seal = seal_double(seal, x[k], k);
    }
    return seal;
}

static int64_t fold_counts(int64_t before, const int64_t x[], int64_t n)
{
    int64_t seal = before;
    for (int64_t k = 0; k < n; k++) {
        if (((uint64_t)k & 63U) == 0U) {
            seal = mixed(seal);
        }
        seal = seal_integer(seal, x[k], k);
    }
    return seal;
}
