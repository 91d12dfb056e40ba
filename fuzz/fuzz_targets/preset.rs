#![no_main]

cloudparity_fuzz::target!("preset", Json);
