# SPDX-License-Identifier: MIT
# The module imuprobe for ports that build with make (pyboard, unix):
#     make USER_C_MODULES=.../firmware/micropython
IMUPROBE_DIR := $(USERMOD_DIR)
IMUPROBE_FIRMWARE := $(abspath $(IMUPROBE_DIR)/../..)

SRC_USERMOD_C += $(IMUPROBE_DIR)/module.c $(IMUPROBE_DIR)/ports.c
SRC_USERMOD_LIB_C += $(wildcard $(IMUPROBE_FIRMWARE)/core/*/*.c)
SRC_USERMOD_LIB_C += $(IMUPROBE_FIRMWARE)/generic/identity.c
CFLAGS_USERMOD += -I$(IMUPROBE_FIRMWARE)
