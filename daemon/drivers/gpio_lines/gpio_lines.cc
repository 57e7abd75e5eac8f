#include "daemon/device/digital_lines.h"
#include "daemon/drivers/driver.h"

namespace mesorig::daemon::gpio_lines {
namespace {

// Borrows the port. Thread-safe as the port is.
class GpioLines final : public DigitalLines {
 public:
  explicit GpioLines(LinePort& port) : port_(port) {}
  ~GpioLines() override {
    port_.OnEdge([](int, bool, RigTime) {});
  }
  StatusOr<bool> Read(int line) override { return port_.Read(line); }
  Status Write(int line, bool level) override { return port_.Write(line, level); }
  void OnEdge(std::function<void(int line, bool level, RigTime when)> on_edge) override {
    port_.OnEdge(std::move(on_edge));
  }

 private:
  LinePort& port_;
};

}  // namespace

Driver Describe() {
  Driver driver;
  driver.make_lines = [](const DriverContext& context) -> StatusOr<std::unique_ptr<DigitalLines>> {
    if (context.lines == nullptr) {
      return FailedPrecondition(
          "digital lines: driver gpio_lines needs a line chip, and there is none");
    }
    return std::make_unique<GpioLines>(*context.lines);
  };
  return driver;
}

}  // namespace mesorig::daemon::gpio_lines
