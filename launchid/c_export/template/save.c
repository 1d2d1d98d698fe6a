/* ---- the state as bytes: preface, the state's words with the least byte first, CRC-32 of all before

   Of the seal of what is carried on, what it is off is saved: 0 but of a state that was damaged before.  The preface
   holds a digest of every choice and of the layout: a state of another configuration or version differs. */

#define WORD_BYTES 8U
#define CHECKSUM_BYTES 4U

static const uint8_t preface[] = {
    $preface};

/* CRC-32 of ISO 3309 (zlib's), four bits at a time: its table is small. */
static uint32_t checksum(const uint8_t bytes[], size_t n)
{
    static const uint32_t of_four_bits[16] = {
        0x00000000U, 0x1DB71064U, 0x3B6E20C8U, 0x26D930ACU, 0x76DC4190U, 0x6B6B51F4U, 0x4DB26158U, 0x5005713CU,
        0xEDB88320U, 0xF00F9344U, 0xD6D6A3E8U, 0xCB61B38CU, 0x9B64C2B0U, 0x86D3D2D4U, 0xA00AE278U, 0xBDBDF21CU};
    uint32_t crc = 0xFFFFFFFFU;
    for (size_t k = 0U; k < n; k++) {
        crc ^= (uint32_t)bytes[k];
        crc = (crc >> 4U) ^ of_four_bits[crc & 15U];
        crc = (crc >> 4U) ^ of_four_bits[crc & 15U];
    }
    return crc ^ 0xFFFFFFFFU;
}

static size_t put_word(uint8_t saved[], size_t at, uint64_t word)
{
    uint64_t rest = word;
    for (size_t k = 0U; k < WORD_BYTES; k++) {
        saved[at + k] = (uint8_t)(rest & 0xFFU);
        rest >>= 8U;
    }
    return at + WORD_BYTES;
}

static uint64_t take_word(const uint8_t saved[], size_t at)
{
    uint64_t word = 0U;
    for (size_t k = WORD_BYTES; k > 0U; k--) {
        word = (word << 8U) | (uint64_t)saved[(at + k) - 1U];
    }
    return word;
}

static size_t put_words(uint8_t saved[], size_t at, const int64_t words[], size_t n)
{
    size_t end = at;
    for (size_t k = 0U; k < n; k++) {
        end = put_word(saved, end, (uint64_t)words[k]);
    }
    return end;
}

static size_t put_numbers(uint8_t saved[], size_t at, const double numbers[], size_t n)
{
    size_t end = at;
    for (size_t k = 0U; k < n; k++) {
        const Bits bits = {.number = numbers[k]};
        end = put_words(saved, end, &bits.word, 1U);
    }
    return end;
}

static size_t take_words(const uint8_t saved[], size_t at, int64_t words[], size_t n)
{
    for (size_t k = 0U; k < n; k++) {
        words[k] = (int64_t)take_word(saved, at + (WORD_BYTES * k));
    }
    return at + (WORD_BYTES * n);
}

static size_t take_numbers(const uint8_t saved[], size_t at, double numbers[], size_t n)
{
    for (size_t k = 0U; k < n; k++) {
        const Bits bits = {.word = (int64_t)take_word(saved, at + (WORD_BYTES * k))};
        numbers[k] = bits.number;
    }
    return at + (WORD_BYTES * n);
}

bool launchid_state_save(const launchid_state *state, uint8_t saved[LAUNCHID_SAVED_BYTES])
{
    if (state->busy == LAUNCHID_BUSY_MARK) {
        return false;
    }
    size_t at = sizeof preface;
    (void)memcpy(saved, preface, sizeof preface);
    const int64_t carried = seal_integer(state->state.guard.carried, $seal, 0);
$saves    uint32_t crc = checksum(saved, at);
    for (size_t k = 0U; k < CHECKSUM_BYTES; k++) {
        saved[at + k] = (uint8_t)(crc & 0xFFU);
        crc >>= 8U;
    }
    return true;
}

launchid_restored launchid_state_restore(launchid_state *state, const uint8_t saved[], size_t bytes)
{
    if (state->busy == LAUNCHID_BUSY_MARK) {
        return LAUNCHID_SAVED_NOT_NOW;
    }
    if (bytes != (size_t)LAUNCHID_SAVED_BYTES) {
        return LAUNCHID_SAVED_NOT_WHOLE;
    }
    size_t at = LAUNCHID_SAVED_BYTES - CHECKSUM_BYTES;
    uint32_t crc = checksum(saved, at);
    for (size_t k = 0U; k < CHECKSUM_BYTES; k++) {
        if (saved[at + k] != (uint8_t)(crc & 0xFFU)) {
            return LAUNCHID_SAVED_DAMAGED;
        }
        crc >>= 8U;
    }
    if (memcmp(saved, preface, sizeof preface) != 0) {
        return LAUNCHID_SAVED_FOREIGN;
    }
    at = sizeof preface;
$restores    (void)at;
    state->state.guard.carried = seal_integer(state->state.guard.carried, $seal, 0);
    return LAUNCHID_RESTORED;
}
