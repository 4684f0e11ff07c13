# SPDX-License-Identifier: MIT
# For MicroPython's unix port: the modelled sensors of sim/chips, whose time is the clock,
# and the module imuprobe inside.
CHIPS := $(abspath $(USERMOD_DIR)/../../../sim/chips)
SRC_USERMOD_C += $(USERMOD_DIR)/chips.c
SRC_USERMOD_LIB_C += $(CHIPS)/i2c_slave.c $(CHIPS)/chip_motion.c
SRC_USERMOD_LIB_C += $(wildcard $(CHIPS)/sensor/*.c $(CHIPS)/mpu9250/*.c $(CHIPS)/lsm9ds0/*.c)
CFLAGS_USERMOD += -I$(CHIPS)
LDFLAGS_USERMOD += -Wl,--wrap=mp_hal_ticks_us

USERMOD_DIR := $(abspath $(USERMOD_DIR)/../../../firmware/micropython/imuprobe)
include $(USERMOD_DIR)/micropython.mk
