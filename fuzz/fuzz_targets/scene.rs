#![no_main]

cloudparity_fuzz::target!("scene", Json);
