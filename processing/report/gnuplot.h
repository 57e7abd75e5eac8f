#pragma once
// Runs gnuplot. It executes what stands between backticks, in strings of its scripts too: so
// scripts are constants of ours, and names and numbers from outside are data.

#include <filesystem>
#include <string>
#include <string_view>

#include "protocol/base/status.h"

namespace mesorig::report {

// One cell of a data file, quoted: quotes and line breaks become spaces, controls vanish.
std::string DataText(std::string_view text);

// Writes `data` to a file beside `png`, runs `script` there, which reads the file `data.txt` of its
// working folder and writes `plot.png`, and moves the picture to `png`. FailedPrecondition: gnuplot
// is not installed; Unavailable, with its message: it failed.
Status Plot(std::string_view script, std::string_view data, const std::filesystem::path& png);

}  // namespace mesorig::report
