// SPDX-License-Identifier: MIT
// What TinyUSB has to be: a device with one serial port.
#ifndef TUSB_CONFIG_H
#define TUSB_CONFIG_H

#define CFG_TUSB_RHPORT0_MODE OPT_MODE_DEVICE
#define CFG_TUD_ENDPOINT0_SIZE 64
#define CFG_TUD_CDC 1
#define CFG_TUD_CDC_RX_BUFSIZE 512
// 0.2 s of poses and raw messages at 200 Hz.
#define CFG_TUD_CDC_TX_BUFSIZE 8192
#define CFG_TUD_CDC_EP_BUFSIZE 64

#endif
