#![no_main]

cloudparity_fuzz::target!("npy");
