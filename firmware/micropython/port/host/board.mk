# SPDX-License-Identifier: MIT
# This machine, with the modelled sensors of sim/chips.
CHIPS := $(abspath ../../../sim/chips)
CHIP_C := i2c_slave.c chip_motion.c
CHIP_C += $(patsubst $(CHIPS)/%,%,$(wildcard $(CHIPS)/sensor/*.c \
  $(CHIPS)/mpu9250/*.c $(CHIPS)/lsm9ds0/*.c))

CFLAGS += -O1 -I$(CHIPS)
LIB := -lm
BOARD_O := $(CHIP_C:%.c=$(BUILD)/chips/%.o)

$(BUILD)/chips/%.o: $(CHIPS)/%.c $(wildcard $(CHIPS)/*.h $(CHIPS)/*/*.h)
	$(Q)$(MKDIR) -p $(@D)
	$(Q)$(CC) $(CFLAGS) -I$(CHIPS) -c -o $@ $<
