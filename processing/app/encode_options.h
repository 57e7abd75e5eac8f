#pragma once
// The options of encoders on a command line.

#include <CLI/CLI.hpp>

#include "processing/codecs/encoder.h"

namespace mesorig::processing {

// Borrows `options`, which the parser fills.
void AddEncodeOptions(CLI::App* command, codecs::EncodeOptions& options);

// --negative keep|clamp alone, which all codecs take.
void AddNegativeOption(CLI::App* command, bool& clamp_negative);

}  // namespace mesorig::processing
