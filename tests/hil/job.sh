# What the guest does (sh, as root): brings its interfaces up and runs the programs of /job/bin, each
# with the kernel interface that it is about. Leaves /job/log, /job/tests.tsv and /job/status.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp
failed=0
echo started >/job/started
modprobe -a vcan can-raw gpio-sim vhci-hcd || failed=1
ip link set lo up
ip link add vcan0 type vcan && ip link set vcan0 up || failed=1
mount -t configfs configfs /sys/kernel/config
chip=/sys/kernel/config/gpio-sim/rig
mkdir -p $chip/bank0
echo 8 >$chip/bank0/num_lines
echo rig-lines >$chip/bank0/label
for line in 0:E-STOP 1:DOOR 3:LASER-GATE; do
  mkdir -p $chip/bank0/line${line%%:*}
  echo ${line#*:} >$chip/bank0/line${line%%:*}/name
done
echo 1 >$chip/live || failed=1
kernel=$(uname -r)

# test PROGRAM FILTER INTERFACE
test_with() {
  /job/bin/$1 --gtest_filter="$2" >/tmp/out 2>&1 || failed=1
  cat /tmp/out >>/job/log
  # Lines "[       OK ] Suite.Test (12 ms)"
  sed -n 's/^\[ *\(OK\|FAILED\) *\] \([^ ]*\) (\([0-9]*\) ms)$/\2\t\1\t\3/p' /tmp/out |
    while IFS="$(printf '\t')" read -r name verdict ms; do
      printf '%s\t%s\t%s\t%s\n' "$name" "$3, Linux $kernel" "$verdict" "$ms"
    done >>/job/tests.tsv
}
test_with hil_bus_test 'SocketCan*' 'vcan0 (can-raw)'
test_with hil_bus_test 'GpioLines*:GpioChips*' 'gpio-sim (character device)'

# The simulated rig, its axes on vcan0 and its laser's brick on the kernel's virtual USB host.
mkdir -p /tmp/rig
{ cat /job/source/rigs/demo.toml; printf '[buses.usb]\nserial = "0016530A1B2C"\n'; } >/tmp/usb_rig.toml
/job/bin/mesorig-sim run --rig /job/source/rigs/demo.toml --sample /job/source/rigs/samples/weave.toml \
  --runtime-dir /tmp/rig >>/job/simulator.txt 2>&1 &
simulator=$!
while [ ! -s /tmp/rig/mesorig-sim.endpoint ] && kill -0 $simulator 2>/dev/null; do sleep 0.2; done
/job/bin/mesorig-sim bridge --runtime-dir /tmp/rig --can vcan0 --usb 3240 --rig /tmp/usb_rig.toml \
  >>/job/simulator.txt 2>&1 &
bridge=$!
sleep 1
test_with hil_driver_test 'CanAxis*' 'vcan0 (can-raw)'
test_with hil_driver_test 'UsbBrick*' 'vhci-hcd (libusb)'
kill $bridge $simulator
wait $bridge $simulator

# mesorigd with its own simulator and bridges.
test_with hil_rig_test '*' 'vcan0, gpio-sim, Modbus RTU on a pty, vhci-hcd'

[ -s /job/tests.tsv ] || failed=1
echo $failed >/job/status
sync
poweroff -f
