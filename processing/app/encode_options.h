#pragma once
// The options of encoders on a command line.

#include <CLI/CLI.hpp>

#include "processing/codecs/encoder.h"

namespace mesorig::processing {

// Borrows `options`, which the parser fills.
void AddEncodeOptions(CLI::App* command, codecs::EncodeOptions& options);

}  // namespace mesorig::processing
